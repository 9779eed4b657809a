"""Watches whether pictures follow the motors: two looks are compared whenever the head has come to rest.

The comparing runs where matches do, one at a time; a look that comes meanwhile takes the place of one that waits.
"""

from __future__ import annotations

import asyncio
import logging
from collections import OrderedDict
from collections.abc import Awaitable, Callable
from dataclasses import dataclass

from ptzd.control import commands as cmd
from ptzd.control import events as ev
from ptzd.errors import PtzdError
from ptzd.model import HeadReading, Motion, Turn, Turned
from ptzd.ports import Picture
from ptzd.runtime.frames import FrameStore

Compare = Callable[[bytes, HeadReading, bytes, HeadReading], Awaitable[Turned]]
"""JPEG and pose of the earlier look, and of the later one."""

SAME_DEG = 0.05
SAME_ZOOM = 8.0
"""Looks from nearer are from the same place."""
RESTED_NS = 800_000_000
"""A picture of the stream counts when the head is known to rest for so long around it."""
AGAIN_NS = 30_000_000_000
"""At rest a look is taken this often,"""
DOUBTFUL_NS = 2_000_000_000
"""and this often while the last one contradicted."""
LATELY_NS = 120_000_000_000
"""Two looks further apart in time may differ by light and weather."""
PLACES = 16
"""Places of which a look is kept."""
UNCLEAR = 3
"""Looks in a row that cannot be compared with the one kept, after which that is of another time of day."""

_log = logging.getLogger(__name__)


@dataclass(slots=True)
class _Look:
    t_ns: int
    reading: HeadReading
    jpeg: bytes
    unclear: int = 0


class MotorWatch:
    """Compares looks and tells the core.

    Parameters
    ----------
    compare : callable
    tell : callable
        :meth:`Pump.tell`.
    frames : FrameStore
        Where the pictures are that the core asked for.
    wanted : callable
        Whether the settings in force ask for it.
    """

    def __init__(
        self, compare: Compare, tell: Callable[[ev.Event], None], frames: FrameStore, wanted: Callable[[], bool]
    ) -> None:
        self._compare = compare
        self._wanted = wanted
        self._tell = tell
        self._frames = frames
        self._waiting: _Look | None = None
        self._came = asyncio.Event()
        self._last: _Look | None = None
        self._places: OrderedDict[tuple[float, float, float], _Look] = OrderedDict()
        self._rest: HeadReading | None = None
        self._since_ns = 0
        self._kept: Picture | None = None
        self._due_ns = 0
        self._contradicted = False
        self._doubt = ""
        self._looking_at: tuple[float, float, float] | None = None

    def seen(self, sequence: int, event: ev.Event, commands: list[cmd.Command]) -> None:
        """Look at one step of the core: its pictures, and losses, after which nothing is as it was."""
        del sequence
        for command in commands:
            if isinstance(command, cmd.PublishStatus):
                self._hear(command.doubt)
        match event:
            case ev.ViewTaken(view=view):
                picture = self._frames.view(view.frame)
                if picture is not None:
                    self._offer(_Look(view.frame.t_capture_ns, view.reading, picture.jpeg))
            case ev.DeviceLost(device=ev.Device.PTZ) | ev.HeadReady():
                self._last = self._waiting = self._rest = None
            case _:
                pass

    def _hear(self, doubt: str) -> None:
        """After a fault only the look that disproved it is to be trusted: others may be from while it lasted."""
        if self._doubt and not doubt:
            self._places = OrderedDict((key, look) for key, look in self._places.items() if key == self._looking_at)
        self._doubt = doubt

    def shown(self, picture: Picture, reading: HeadReading, motion: Motion) -> None:
        """A picture of the stream; one out of the middle of a rest is looked at, and again from time to time."""
        t_ns = picture.frame.t_capture_ns
        if motion is not Motion.STABLE or self._rest is None or not _same(reading, self._rest):
            self._rest = reading if motion is Motion.STABLE else None
            self._since_ns, self._due_ns, self._kept = t_ns, t_ns, None
            return
        if self._kept is None and t_ns >= self._since_ns + RESTED_NS // 2:
            self._kept = picture
        if self._kept is not None and t_ns >= self._since_ns + RESTED_NS and t_ns >= self._due_ns:
            self._offer(_Look(self._kept.frame.t_capture_ns, reading, self._kept.jpeg))
            self._due_ns = t_ns + (DOUBTFUL_NS if self._contradicted else AGAIN_NS)
            self._since_ns, self._kept = t_ns, None

    def _offer(self, look: _Look) -> None:
        if self._wanted():
            self._waiting = look
            self._came.set()

    async def run(self) -> None:
        """Compare until cancelled."""
        while True:
            await self._came.wait()
            self._came.clear()
            look, self._waiting = self._waiting, None
            if look is not None:
                await self._look(look)

    async def _look(self, look: _Look) -> None:
        last, self._last = self._last, look
        if last is not None and not _same(last.reading, look.reading) and look.t_ns - last.t_ns <= LATELY_NS:
            await self._compared(last, look, reference=False)
        key = next((key for key, kept in self._places.items() if _same(kept.reading, look.reading)), None)
        if key is None:
            if not self._contradicted and not self._doubt:
                self._keep(look)
            return
        kept, self._looking_at = self._places[key], key
        self._places.move_to_end(key)
        verdict = await self._compared(kept, look, reference=True)
        self._looking_at = None
        kept.unclear = kept.unclear + 1 if verdict is Turn.UNKNOWN else 0
        if verdict is Turn.AGREES or kept.unclear >= UNCLEAR:
            self._places[key] = look

    async def _compared(self, before: _Look, after: _Look, *, reference: bool) -> Turn:
        try:
            found = await self._compare(before.jpeg, before.reading, after.jpeg, after.reading)
        except PtzdError as error:
            _log.debug("two looks cannot be compared: %s", error)
            return Turn.UNKNOWN
        if found.verdict is Turn.UNKNOWN:
            return Turn.UNKNOWN
        contradicts = found.verdict is not Turn.AGREES
        if contradicts and not self._contradicted:
            self._due_ns = min(self._due_ns, after.t_ns + DOUBTFUL_NS)
        self._contradicted = contradicts
        self._tell(ev.ViewsCompared(found=found, reference=reference))
        return found.verdict

    def _keep(self, look: _Look) -> None:
        reading = look.reading
        self._places[reading.pan_deg, reading.tilt_deg, reading.zoom] = look
        while len(self._places) > PLACES:
            self._places.popitem(last=False)


def _same(one: HeadReading, other: HeadReading) -> bool:
    apart = max(abs(one.pan_deg - other.pan_deg), abs(one.tilt_deg - other.tilt_deg))
    return apart <= SAME_DEG and abs(one.zoom - other.zoom) <= SAME_ZOOM
