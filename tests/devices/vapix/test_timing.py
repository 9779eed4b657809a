from __future__ import annotations

import contextlib

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ptzd.config import Limits, Ptz
from ptzd.devices.vapix.head import VapixHead
from ptzd.devices.vapix.timing import measure_timing, progress_of_reports, step_offset_s
from ptzd.errors import DeviceGarbled, DeviceLost
from ptzd.model import HeadReading
from ptzd.runtime.clock import SteadyClock
from ptzd.sim.rig import SimRig
from ptzd.sim.settings import SimSettings


def curve(t_s: float) -> float:
    """A step from 0 to 1 between 1.0 s and 1.3 s with smooth ends."""
    u = min(max((t_s - 1.0) / 0.3, 0.0), 1.0)
    return u * u * (3 - 2 * u)


def sampled(step_s: float, phase_s: float, delay_s: float) -> list[tuple[int, float]]:
    times = [phase_s + step_s * index for index in range(int(2.5 / step_s))]
    return [(round(t * 1e9), curve(t - delay_s)) for t in times]


@settings(max_examples=25)
@given(st.floats(-0.4, 0.4), st.floats(0, 0.04), st.floats(0, 0.04))
def test_the_delay_between_two_curves_is_found(offset_s, phase_a, phase_b):
    reports, pictures = sampled(0.04, phase_a, 0.0), sampled(0.04, phase_b, offset_s)
    assert step_offset_s(reports, pictures) == pytest.approx(offset_s, abs=0.005)


def test_without_motion_there_is_no_delay():
    still = [(index * 40_000_000, 0.0) for index in range(50)]
    assert step_offset_s(sampled(0.04, 0, 0), still) is None
    assert progress_of_reports([(0, HeadReading(pan_deg=1, tilt_deg=0, zoom=1))] * 3) == []
    assert progress_of_reports([]) == []


@pytest.fixture
async def described(tmp_path):
    (tmp_path / "password").write_text("pan-tilt-zoom")
    async with SimRig(SimSettings(image_latency_s=0.15)) as rig:
        ptz = Ptz(
            url=rig.camera.url, user="ptzd", password_file=str(tmp_path / "password"), size_px=(320, 240), fps=25.0,
            poll_hz=25.0,
        )  # fmt: skip
        async with VapixHead(ptz, Limits(), SteadyClock()) as head:
            await head.describe()
            yield rig, head


async def test_the_delay_of_a_camera_is_measured(described):
    """What is measured in moments when the machine has no time for it is no measurement; one must be right."""
    rig, head = described
    timing = rig.camera.unit.profile.timing
    truth_s = rig.settings.image_latency_s - timing.report_lag_s - timing.report_refresh_s / 2
    offsets_s: list[float] = []
    for _ in range(8):
        with contextlib.suppress(DeviceGarbled):
            found = await measure_timing(head, HeadReading(pan_deg=5, tilt_deg=0, zoom=1), steps=2)
            assert found.steps >= 1
            offsets_s.append(found.offset_s)
            if found.offset_s == pytest.approx(truth_s, abs=0.04):
                return
    pytest.fail(f"{offsets_s} instead of {truth_s}")


async def test_a_camera_that_shows_nothing_is_said_so(head):
    with pytest.raises(DeviceGarbled, match="point the camera at something with texture"):
        await measure_timing(head, HeadReading(pan_deg=5, tilt_deg=0, zoom=1), steps=1)


async def test_a_stream_that_is_lost_meanwhile_is_named_and_not_the_scene(described, monkeypatch):
    _, head = described

    async def lost():
        raise DeviceLost("http://camera/video: the stream ended")
        yield

    monkeypatch.setattr(head, "pictures", lost)
    start = (await anext(head.polls())).reading
    with pytest.raises(DeviceLost, match="the stream ended"):
        await measure_timing(head, start, steps=2)
