import math

import numpy as np
import pytest
from hypothesis import strategies as st

from ptzd.geometry.head import Axis, HeadModel
from ptzd.geometry.rig import Rig, Uncertainty
from ptzd.geometry.sphere import normalise, rotation_from_rotvec
from ptzd.geometry.unified import UnifiedCamera
from ptzd.geometry.zoom import ZoomEntry, ZoomTable


class Draw:
    """Strategies that several modules use."""

    unit = st.floats(-1.0, 1.0)
    directions = (
        st.tuples(unit, unit, unit).filter(lambda v: math.hypot(*v) > 0.1).map(lambda v: normalise(np.array(v)))
    )
    rotations = st.tuples(*[st.floats(-1.8, 1.8)] * 3).map(lambda v: rotation_from_rotvec(np.array(v)))
    translations = st.tuples(directions, st.floats(0.1, 2.0)).map(lambda v: v[0] * v[1])


@pytest.fixture(scope="session")
def draw():
    return Draw


def _rig(rotation=None, translation=(-0.5, -0.1, -0.05), *, misalignment=(0.0, 0.0, 0.0), uncertainty="given"):
    entries = (
        ZoomEntry(zoom=1, fx=554.3, fy=554.3, cx=319.5, cy=239.5, distortion=(-0.1, 0.02, 1e-3, -1e-3, 0.0)),
        ZoomEntry(zoom=5000, fx=2200.0, fy=2190.0, cx=321.0, cy=238.0),
    )
    given = Uncertainty(rotation_rad=0.003, translation=0.005, head_rad=0.001)
    return Rig(
        fisheye=UnifiedCamera(size_px=(640, 480), fx=282.0, fy=282.0, cx=319.5, cy=239.5, xi=1.2, max_angle_rad=1.6),
        zoom=ZoomTable(size_px=(640, 480), entries=entries),
        head=HeadModel(
            pan=Axis(sign=-1, scale=1.01, offset_rad=0.2), tilt=Axis(offset_rad=-0.05), camera_rotvec_rad=misalignment
        ),
        head_from_fisheye_rotation=np.eye(3) if rotation is None else rotation,
        head_from_fisheye_translation=np.array(translation, dtype=float),
        metric=True,
        uncertainty=given if uncertainty == "given" else uncertainty,
    )


@pytest.fixture(scope="session")
def make_rig():
    return _rig
