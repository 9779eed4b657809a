"""The newest picture of each kind with what it shows: published while somebody listens, given to whoever asks."""

from __future__ import annotations

from ptzd.geometry.rig import Rig
from ptzd.model import HeadReading, Motion
from ptzd.outgoing import ImageAttachment
from ptzd.ports import Bus, Picture
from ptzd.runtime.attachments import frame_attachment, view_attachment
from ptzd.runtime.overlays import KEY as OVERLAY
from ptzd.runtime.overlays import Overlays

FISHEYE, PTZ = "image/fisheye", "image/ptz"


class Gallery:
    """Pictures for people.

    Parameters
    ----------
    rig : Rig
        Sizes, and what the head's readings mean.
    bus : Bus
        Where the pictures go.
    overlays : Overlays
        Draws what was found.
    """

    def __init__(self, *, rig: Rig, bus: Bus, overlays: Overlays) -> None:
        self._rig = rig
        self._bus = bus
        self._overlays = overlays
        self._fisheye: Picture | None = None
        self._ptz: tuple[Picture, HeadReading, Motion] | None = None

    def show_fisheye(self, picture: Picture) -> None:
        """A frame has come."""
        self._fisheye = picture
        if self._bus.image_wanted(FISHEYE):
            self._bus.publish_image(FISHEYE, picture.jpeg, frame_attachment(picture.frame, self._rig.fisheye.size_px))

    def show_ptz(self, picture: Picture, reading: HeadReading, motion: Motion) -> None:
        """A picture of the PTZ has come, and this is where its head looked."""
        self._ptz = picture, reading, motion
        if self._bus.image_wanted(PTZ):
            self._bus.publish_image(PTZ, picture.jpeg, view_attachment(self._rig, picture.frame, reading, motion))

    async def newest(self, key: str) -> tuple[bytes, ImageAttachment] | None:
        """JPEG and attachment of ``image/fisheye``, ``image/ptz`` or ``image/overlay``; None while there is none."""
        if key == OVERLAY:
            return await self._overlays.newest()
        if key == FISHEYE and self._fisheye is not None:
            return self._fisheye.jpeg, frame_attachment(self._fisheye.frame, self._rig.fisheye.size_px)
        if key == PTZ and self._ptz is not None:
            picture, reading, motion = self._ptz
            return picture.jpeg, view_attachment(self._rig, picture.frame, reading, motion)
        return None
