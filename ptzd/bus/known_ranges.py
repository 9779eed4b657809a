"""Messages about what locks have taught of the scene's ranges."""

from __future__ import annotations

from typing import Annotated

from msgspec import Meta

from ptzd.bus.fields import BoxPx, Incoming
from ptzd.control.commands import ReplyRanges
from ptzd.outgoing import Outgoing


class RangesRequest(Incoming, frozen=True):
    """Tell what is known; with at most one of the fields, after something was taken back."""

    forget_last: Annotated[int, Meta(ge=1, le=100_000)] | None = None
    """What the newest so many locks have taught."""
    forget_box: BoxPx | None = None
    """What lies in this rectangle of the fisheye's picture."""
    forget_all: bool = False


class RangeKnown(Outgoing, frozen=True):
    """What one lock has taught."""

    id: str
    """Of its request."""
    x: float
    """Where it lies in the fisheye's picture, px."""
    y: float
    learned_ns: int
    weight: float
    """What it still counts, 1 when new."""
    sigma_share: float
    """One sigma, as a share of the range."""
    range_m: float | None = None
    """Absent when infinite, or when the rig is not metric."""
    range_baselines: float | None = None
    """In distances of both cameras, when the rig is not metric."""


class RangesReply(Outgoing, frozen=True):
    """What is known now, oldest first."""

    t_ns: int
    """Now, on the clock of ``learned_ns``."""
    learning: bool
    """Whether locks teach, and what is known is used."""
    forgotten: int = 0
    """How many were taken back just now."""
    known: tuple[RangeKnown, ...] = ()

    @classmethod
    def of(cls, told: ReplyRanges, t_ns: int, *, metric: bool) -> RangesReply:
        """The core's answer as the bus tells it."""
        known = tuple(
            RangeKnown(
                id=one.id,
                x=one.x_px,
                y=one.y_px,
                learned_ns=one.learned_ns,
                weight=one.weight,
                sigma_share=one.sigma_share,
                range_m=one.range_m if metric else None,
                range_baselines=None if metric else one.range_m,
            )
            for one in told.known
        )
        return cls(t_ns=t_ns, learning=told.learning, forgotten=told.forgotten, known=known)
