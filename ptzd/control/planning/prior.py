"""What the map of ranges says of one request, now."""

from __future__ import annotations

import numpy as np

from ptzd.control.planning.expected import ExpectedOnArc
from ptzd.control.planning.neighbourhood import arc_of
from ptzd.control.requests import Request
from ptzd.control.work import Work


def expected_on_arc(work: Work, request: Request) -> ExpectedOnArc | None:
    """Where along its arc the target is expected; None where nothing is known, or nothing is to be used."""
    settings, arc = work.config.ranges, arc_of(work.rig, request)
    if not (settings.learn and work.ranges.locks) or arc.degenerate:
        return None
    x, y, z = work.rig.fisheye.lift(np.array(request.box.centre))[0].tolist()
    baseline = float(np.linalg.norm(arc.translation))
    expected = work.ranges.at((x, y, z), work.t_ns, half_life_h=settings.half_life_h, baseline=baseline)
    return expected.along(arc) if expected.humps else None
