"""The picture for people: the last matched view with the found box drawn into it, for the bus key ``image/overlay``."""

from __future__ import annotations

import asyncio
import logging
from collections import OrderedDict
from dataclasses import dataclass

import cv2
import numpy as np

from ptzd.control import commands as cmd
from ptzd.control import events as ev
from ptzd.errors import DeviceGarbled
from ptzd.geometry.rig import Rig
from ptzd.jpeg.pixels import decode_bgr
from ptzd.model import Candidate, Motion, ViewRef
from ptzd.outgoing import ImageAttachment
from ptzd.ports import Bus
from ptzd.runtime.attachments import view_attachment
from ptzd.runtime.frames import FrameStore

_log = logging.getLogger("ptzd")

GREEN_BGR = (80, 220, 80)
KEY = "image/overlay"
FAR_PX = 1e5
"""Beyond it OpenCV's fixed-point drawing overflows."""
REMEMBERED = 64
"""Matches whose view is remembered until they answer; more are never under way at once."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Shown:
    """A view and what was found in it."""

    view: ViewRef
    jpeg: bytes
    candidate: Candidate


class Overlays:
    """Watches matches and draws their answers, off the loop and only while somebody looks.

    Parameters
    ----------
    rig : Rig
        Tells what the view shows.
    bus : Bus
        Where the picture goes.
    frames : FrameStore
        Where the views are.
    """

    def __init__(self, *, rig: Rig, bus: Bus, frames: FrameStore) -> None:
        self._rig = rig
        self._bus = bus
        self._frames = frames
        self._last: Shown | None = None
        self._views: OrderedDict[int, ViewRef] = OrderedDict()
        self._drawing: set[asyncio.Task[None]] = set()

    def seen(self, t_ns: int, event: ev.Event, commands: list[cmd.Command]) -> None:
        """Look at one step of the core."""
        del t_ns
        for command in commands:
            if isinstance(command, cmd.RunMatch):
                self._views[command.match_id] = command.view
                while len(self._views) > REMEMBERED:
                    self._views.popitem(last=False)
        if isinstance(event, ev.MatchFinished):
            view = self._views.pop(event.match_id, None)
            picture = None if view is None else self._frames.view(view.frame)
            if view is not None and picture is not None and event.result.candidates:
                self._last = Shown(view=view, jpeg=picture.jpeg, candidate=event.result.candidates[0])
                if self._bus.image_wanted(KEY):
                    task = asyncio.create_task(self._publish())
                    self._drawing.add(task)
                    task.add_done_callback(self._drawing.discard)

    async def newest(self) -> tuple[bytes, ImageAttachment] | None:
        """JPEG and attachment of the last match that found something; None when there is none or it cannot be drawn."""
        shown = self._last
        if shown is None:
            return None
        try:
            jpeg = await asyncio.to_thread(draw_candidate, shown.jpeg, shown.candidate)
        except (DeviceGarbled, cv2.error) as error:
            _log.warning("overlay: %s", " ".join(str(error).split()))
            return None
        view = shown.view
        return jpeg, view_attachment(self._rig, view.frame, view.reading, Motion.STABLE)

    async def close(self) -> None:
        """Wait for the drawings under way."""
        await asyncio.gather(*self._drawing)

    async def _publish(self) -> None:
        drawn = await self.newest()
        if drawn is not None:
            self._bus.publish_image(KEY, *drawn)


def draw_candidate(jpeg: bytes, candidate: Candidate) -> bytes:
    """Draw a candidate's box and score into a view; JPEG in, JPEG out.

    Raises
    ------
    DeviceGarbled
        When the view is no picture.
    """
    pixels = decode_bgr(jpeg)
    corners = np.round(np.nan_to_num(np.clip(candidate.box_px, -FAR_PX, FAR_PX))).astype(np.int32)
    cv2.polylines(pixels, [corners.reshape(-1, 1, 2)], isClosed=True, color=GREEN_BGR, thickness=2)
    cv2.putText(pixels, f"{candidate.score:.2f}", (8, 24), cv2.FONT_HERSHEY_SIMPLEX, 0.7, GREEN_BGR, 2)
    return bytes(cv2.imencode(".jpg", pixels)[1])
