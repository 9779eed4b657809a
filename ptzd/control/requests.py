"""An accepted request, and how far it has come."""

from __future__ import annotations

from dataclasses import dataclass, field

from ptzd.control.events import ZoomWish
from ptzd.model import Box, FrameRef, HeadReading, Region


@dataclass(slots=True, kw_only=True)
class Request:
    """An accepted request."""

    id: str
    label: str
    priority: int
    region: Region
    inverse_range: tuple[float, float]
    """1/m or 1/baseline, far end first."""
    zoom: ZoomWish
    hfov_deg: float | None
    fill: float
    hold_ns: int
    accepted_ns: int
    expires_ns: int
    """To be locked by then."""
    by: str = ""
    """Who asked."""
    newer: Region | None = None
    """The newest update; waits for the look under way, or for the lock to begin."""
    pinned: list[FrameRef] = field(default_factory=list)
    """Frames whose bytes are kept for the request."""

    @property
    def box(self) -> Box:
        """What is looked for, px of the fisheye."""
        return self.region.box

    @property
    def frame(self) -> FrameRef:
        """The fisheye frame that the box lies in."""
        return self.region.frame

    def adopt_newest(self) -> bool:
        """Take over the newest update, if one waits."""
        if self.newer is None:
            return False
        self.region, self.newer = self.newer, None
        return True


@dataclass(frozen=True, slots=True, kw_only=True)
class Missed:
    """A look that a shadow would have taken."""

    reading: HeadReading
    after_ns: int
    """Since the request was accepted."""


@dataclass(slots=True, kw_only=True)
class Task:
    """A request that is served or waits for it, over all the activities that serve it."""

    request: Request
    rescans: int = 0
    """How often a target that was found and lost has been searched for anew."""
    views: int = 0
    """Pictures taken for it."""
    missed: list[Missed] = field(default_factory=list)
    """Pictures that a shadow would have taken for it."""
    alike: bool = False
    """Other places of its arc looked like it: a lock on one of them might be one on a copy."""
