"""Whether the head can be believed: pictures and reports against what it was told, and what follows from that.

One contradiction is an accident: a picture taken at the wrong moment, a lorry in front of the mast. Two that say the
same are a fault, and it is told until a picture disproves it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from ptzd.model import HeadReading, Turn, Turned

WITNESSES = 2
ALIKE = 0.3
"""Slips are the same when they differ by no more than this share, or by :data:`ALIKE_DEG`."""
ALIKE_DEG = 0.3
FAR_DEG = 1.0
"""A head told to turn this far that did not is stuck; nearer, it may only be coarse."""
STAYED_DEG = 0.1


@dataclass(slots=True, kw_only=True)
class Doubts:
    """What speaks against the head."""

    unmoved: int = 0
    """Pictures in a row that did not change though the head was reported elsewhere."""
    stayed: int = 0
    """Moves in a row after which it was reported where it had been."""
    slipped: int = 0
    """Pictures in a row that look elsewhere than reported, by the same angles."""
    pan_off_deg: float = 0.0
    tilt_off_deg: float = 0.0
    testified: HeadReading | None = None
    """The place whose earlier look contradicts: only this one can take it back."""
    stuck: str = ""
    """Why it counts as stuck; empty: it does not."""
    lost: str = ""
    """Why its zero counts as lost."""

    @property
    def words(self) -> str:
        """For the status; empty when it can be believed."""
        return self.stuck or self.lost

    def compared(self, found: Turned, *, reference: bool) -> None:
        """Two pictures were compared; ``reference``: the earlier one was taken at this very place before."""
        match found.verdict:
            case Turn.AGREES:
                if found.turned:
                    self.unmoved, self.stuck = 0, ""
                if reference and (self.testified is None or _apart_deg(self.testified, found.after) <= STAYED_DEG):
                    self.slipped, self.lost, self.testified = 0, "", None
            case Turn.UNMOVED:
                self.unmoved += 1
                if self.unmoved >= WITNESSES and not self.stuck:
                    self.stuck = (
                        f"stuck: reported at {_shown(found.after)} after {_shown(found.before)}, and the pictures "
                        f"did not change"
                    )
            case Turn.SLIPPED:
                again = self.slipped and self._alike(found)
                self.slipped = self.slipped + 1 if again else 1
                self.pan_off_deg, self.tilt_off_deg = found.pan_off_deg, found.tilt_off_deg
                if reference:
                    self.testified = found.after
                if self.slipped >= WITNESSES and self.testified is not None and not self.lost:
                    self.lost = (
                        f"lost its zero: pictures look {found.pan_off_deg:+.2f}° in pan and {found.tilt_off_deg:+.2f}° "
                        f"in tilt off what is reported"
                    )
            case Turn.UNKNOWN:
                pass

    def _alike(self, found: Turned) -> bool:
        size = math.hypot(found.pan_off_deg, found.tilt_off_deg)
        apart = math.hypot(found.pan_off_deg - self.pan_off_deg, found.tilt_off_deg - self.tilt_off_deg)
        return apart <= max(ALIKE * size, ALIKE_DEG)

    def came(self, start: HeadReading, target: HeadReading, rests: HeadReading) -> None:
        """A move from ``start`` to ``target`` is over, and the head is reported at rest."""
        if _apart_deg(start, target) < FAR_DEG:
            return
        if _apart_deg(start, rests) > STAYED_DEG:
            if self.stayed >= WITNESSES:
                self.stuck = ""
            self.stayed = 0
            return
        self.stayed += 1
        if self.stayed >= WITNESSES and not self.stuck:
            self.stuck = f"stuck: told to go to {_shown(target)}, it stays at {_shown(rests)}"


def _apart_deg(one: HeadReading, other: HeadReading) -> float:
    return math.hypot(math.remainder(one.pan_deg - other.pan_deg, 360.0), one.tilt_deg - other.tilt_deg)


def _shown(reading: HeadReading) -> str:
    return f"pan {reading.pan_deg:.2f}°, tilt {reading.tilt_deg:.2f}°"
