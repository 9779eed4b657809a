"""What a lock teaches of the scene's ranges, and what is taken back."""

from __future__ import annotations

import math

import numpy as np

from ptzd.control.activities.lock import Lock
from ptzd.control.planning.neighbourhood import arc_of
from ptzd.control.planning.ranges import RangeLock
from ptzd.control.work import Work
from ptzd.model import Outcome

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
