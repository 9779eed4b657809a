"""Places on the sphere: there and back over random mountings, and at the ends of what the head can do."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ptzd.control.planning.places import place_seen, reading_at
from ptzd.control.planning.reach import reach_of
from ptzd.errors import RequestRefused
from ptzd.geometry.head import Axis, HeadModel
from ptzd.geometry.sphere import rotation_from_rotvec
from ptzd.model import HeadLimits, HeadReading
from ptzd.presets import Place

LIMITS = HeadLimits(pan_deg=(-170, 170), tilt_deg=(-80, 80), zoom=(1, 9999))
ANGLE = st.floats(-3.0, 3.0)


@settings(max_examples=200, deadline=None)
@given(
    mount=st.tuples(ANGLE, ANGLE, ANGLE),
    sign=st.sampled_from([-1, 1]),
    offset_deg=st.floats(-200.0, 200.0),
    crooked=st.tuples(st.floats(-0.03, 0.03), st.floats(-0.03, 0.03)),
    pan_deg=st.floats(-170.0, 170.0),
    tilt_deg=st.floats(-80.0, 80.0),
    zoom=st.floats(1.0, 9999.0),
)
def test_what_a_pose_looks_at_leads_back_to_it(
    rig, config, mount, sign, offset_deg, crooked, pan_deg, tilt_deg, zoom
) -> None:
    head = HeadModel(
        pan=Axis(sign=sign, offset_rad=math.radians(offset_deg)), tilt=Axis(), camera_rotvec_rad=(*crooked, 0.0)
    )
    mounted = dataclasses.replace(rig, head=head, head_from_fisheye_rotation=rotation_from_rotvec(mount))
    pose = HeadReading(pan_deg=pan_deg, tilt_deg=tilt_deg, zoom=zoom)
    back = reading_at(mounted, config, reach_of(LIMITS, mounted, ()), "here", place_seen(mounted, pose))
    axes = [mounted.head_from_camera(each) @ np.array([0.0, 0.0, 1.0]) for each in (pose, back)]
    assert axes[0] == pytest.approx(axes[1], abs=1e-6)
    assert back.zoom == pytest.approx(zoom, rel=1e-5, abs=1e-3)
    assert LIMITS.contains(back)


def written(place: Place) -> Place:
    """As a file has it."""
    return Place(
        azimuth_deg=round(place.azimuth_deg, 3),
        elevation_deg=round(place.elevation_deg, 3),
        hfov_deg=round(place.hfov_deg, 3),
    )


@pytest.mark.parametrize("pan_deg", [-170.0, 170.0])
@pytest.mark.parametrize("tilt_deg", [-80.0, 80.0])
@pytest.mark.parametrize("zoom", [1.0, 9999.0])
def test_the_very_corners_of_the_limits_are_places_too(rig, config, pan_deg, tilt_deg, zoom) -> None:
    pose = HeadReading(pan_deg=pan_deg, tilt_deg=tilt_deg, zoom=zoom)
    back = reading_at(rig, config, reach_of(LIMITS, rig, ()), "corner", written(place_seen(rig, pose)))
    assert LIMITS.contains(back)
    assert (back.pan_deg, back.tilt_deg) == pytest.approx((pan_deg, tilt_deg), abs=0.01)
    assert back.zoom == pytest.approx(zoom, abs=config.ptz.zoom_tolerance)


def test_a_whole_turn_away_is_the_same_direction(rig, config) -> None:
    limits = dataclasses.replace(LIMITS, pan_deg=(10.0, 350.0))
    place = Place(azimuth_deg=-90.0, elevation_deg=0.0, hfov_deg=40.0)
    assert reading_at(rig, config, reach_of(limits, rig, ()), "left", place).pan_deg == pytest.approx(270.0)


@pytest.mark.parametrize(
    ("place", "limits", "message"),
    [
        (Place(azimuth_deg=0, elevation_deg=85, hfov_deg=40), LIMITS, "up lies at pan 0.00°, tilt 85.00°, zoom 1018"),
        (Place(azimuth_deg=0, elevation_deg=0, hfov_deg=90), LIMITS, "up is 90° wide, the camera is calibrated"),
        (Place(azimuth_deg=0, elevation_deg=0, hfov_deg=1), LIMITS, "up is 1° wide, the camera is calibrated"),
        (
            Place(azimuth_deg=0, elevation_deg=0, hfov_deg=5),
            dataclasses.replace(LIMITS, zoom=(1, 2000)),
            "up lies at pan 0.00°, tilt 0.00°, zoom 7065",
        ),
    ],
)  # fmt: skip
def test_what_the_head_cannot_show_is_refused(rig, config, place, limits, message) -> None:
    with pytest.raises(RequestRefused, match=r"outside the head's limits|calibrated for") as refused:
        reading_at(rig, config, reach_of(limits, rig, ()), "up", place)
    assert refused.value.message.startswith(message)
    assert refused.value.code == "unreachable"
