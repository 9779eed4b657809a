"""The picture for people: the last matched view with the found box drawn into it, for the bus key ``image/overlay``."""

from __future__ import annotations

import asyncio
from collections import OrderedDict

import cv2
import numpy as np

from ptzd.control import commands as cmd
from ptzd.control import events as ev
from ptzd.jpeg.pixels import decode_bgr
from ptzd.model import Candidate, ViewRef
from ptzd.ports import Bus
from ptzd.runtime.frames import FrameStore

GREEN_BGR = (80, 220, 80)
KEY = "image/overlay"
REMEMBERED = 64
"""Matches whose view is remembered until they answer; more are never under way at once."""


class Overlays:
    """Watches matches and draws their answers, off the loop and only while somebody looks.

    Parameters
    ----------
    bus : Bus
        Where the picture goes.
    frames : FrameStore
        Where the views are.
    """

    def __init__(self, *, bus: Bus, frames: FrameStore) -> None:
        self._bus = bus
        self._frames = frames
        self._views: OrderedDict[int, ViewRef] = OrderedDict()
        self._drawing: set[asyncio.Task[None]] = set()

    def seen(self, sequence: int, event: ev.Event, commands: list[cmd.Command]) -> None:
        """Look at one step of the core."""
        del sequence
        for command in commands:
            if isinstance(command, cmd.RunMatch):
                self._views[command.match_id] = command.view
                while len(self._views) > REMEMBERED:
                    self._views.popitem(last=False)
        if isinstance(event, ev.MatchFinished):
            view = self._views.pop(event.match_id, None)
            if view is not None and event.result.candidates and self._bus.image_wanted(KEY):
                task = asyncio.create_task(self._draw(view, event.result.candidates[0]))
                self._drawing.add(task)
                task.add_done_callback(self._drawing.discard)

    async def close(self) -> None:
        """Wait for the drawings under way."""
        await asyncio.gather(*self._drawing)

    async def _draw(self, view: ViewRef, candidate: Candidate) -> None:
        picture = self._frames.view(view.frame)
        if picture is None:
            return
        jpeg = await asyncio.to_thread(draw_candidate, picture.jpeg, candidate)
        attachment: dict[str, object] = {"seq": view.frame.seq, "t_capture_ns": view.frame.t_capture_ns}
        self._bus.publish_image(KEY, jpeg, attachment | {"zoom": view.reading.zoom})


def draw_candidate(jpeg: bytes, candidate: Candidate) -> bytes:
    """Draw a candidate's box and score into a view; JPEG in, JPEG out."""
    pixels = decode_bgr(jpeg)
    corners = np.round(np.array(candidate.box_px)).astype(np.int32)
    cv2.polylines(pixels, [corners.reshape(-1, 1, 2)], isClosed=True, color=GREEN_BGR, thickness=2)
    cv2.putText(pixels, f"{candidate.score:.2f}", (8, 24), cv2.FONT_HERSHEY_SIMPLEX, 0.7, GREEN_BGR, 2)
    return bytes(cv2.imencode(".jpg", pixels)[1])
