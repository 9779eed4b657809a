"""What a lock teaches of the scene's ranges, and what is taken back."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ptzd.control import commands as cmd
from ptzd.control import events as ev
from ptzd.control.activities.lock import Lock
from ptzd.control.planning.neighbourhood import arc_of
from ptzd.control.planning.ranges import KnownRange, RangeLock
from ptzd.control.work import Work
from ptzd.geometry.types import Array, Mask
from ptzd.model import Box, Outcome

TEACH = frozenset({Outcome.LOCKED, Outcome.RELEASED})
"""Only a lock that ended well."""


def learn(work: Work, lock: Lock, outcome: Outcome) -> None:
    """Let a lock that has ended teach the range in its direction."""
    if not work.config.ranges.learn or outcome not in TEACH:
        return
    taught = range_taught(work, lock)
    if taught is not None:
        work.ranges.learn(taught)


def range_taught(work: Work, lock: Lock) -> RangeLock | None:
    """The range that a lock has measured.

    None where no picture has confirmed the very box that its client asked for last, where other places looked like it
    (this may be a copy), and where the ray lies so near the baseline that no range can be told.
    """
    request = lock.task.request
    confirmed = lock.confirmed and lock.misses == 0 and not lock.moved
    arc = arc_of(work.rig, request)
    if not confirmed or lock.task.alike or arc.degenerate:
        return None
    ray = work.rig.fisheye.lift(np.array(request.box.centre))[0]
    s = lock.place.inverse_range
    sigma_rad = math.radians(lock.sigma_deg)
    point = arc.rotated + s * arc.translation
    per_rad = float(point @ point) / float(arc.translation @ arc.forward)
    x, y, z = ray.tolist()
    return RangeLock(id=request.id, ray=(x, y, z), inverse_range=s, sigma=sigma_rad * per_rad, t_ns=lock.confirmed_ns)


@dataclass(slots=True, kw_only=True)
class Lessons:
    """What is known, told to people and taken back by them."""

    work: Work

    def on_asked(self, event: ev.RangesAsked) -> None:
        """Forget what is to be forgotten, and tell what is left."""
        ranges = self.work.ranges
        count = len(ranges.locks) if event.forget_all else event.forget_last
        forgotten = ranges.forget_last(count) if count else []
        if event.forget_box is not None:
            forgotten += ranges.forget_where(self._seen_in(event.forget_box))
        if event.token is not None:
            self.work.out.append(
                cmd.ReplyRanges(
                    token=event.token,
                    learning=self.work.config.ranges.learn,
                    forgotten=len(forgotten),
                    known=self._known(),
                )
            )

    def _seen_in(self, box: Box) -> Callable[[Array], Mask]:
        def inside(rays: Array) -> Mask:
            pixels, valid = self.work.rig.fisheye.project(rays)
            low, high = np.array([box.x, box.y]), np.array([box.x + box.w, box.y + box.h])
            return np.asarray(valid & (pixels >= low).all(axis=-1) & (pixels <= high).all(axis=-1))

        return inside

    def _known(self) -> tuple[KnownRange, ...]:
        work, locks = self.work, self.work.ranges.locks
        weights = work.ranges.weights(work.t_ns, work.config.ranges.half_life_h).tolist()
        pixels = work.rig.fisheye.project(np.array([lock.ray for lock in locks]).reshape(-1, 3))[0].tolist()
        return tuple(
            KnownRange(
                id=lock.id,
                x_px=round(x, 1),
                y_px=round(y, 1),
                range_m=round(1.0 / lock.inverse_range, 4) if lock.inverse_range > 1e-6 else None,
                sigma_share=round(lock.sigma / max(lock.inverse_range, lock.sigma), 4),
                learned_ns=lock.t_ns,
                weight=round(weight, 4),
            )
            for lock, (x, y), weight in zip(locks, pixels, weights, strict=True)
        )
