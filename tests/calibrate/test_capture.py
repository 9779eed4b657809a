"""The fisheye's picture for a calibration without a board: a mean of several, of a source that may stumble."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ptzd.calibrate import capture
from ptzd.calibrate.capture import (
    FRAMES,
    ZOOMS,
    pictures_in_a_row,
    tele_plan,
    texture,
    wide_plan,
    write_mean,
)
from ptzd.errors import CalibrationError, DeviceLost
from ptzd.model import FrameRef, HeadLimits
from ptzd.ports import Picture

GREY = cv2.GaussianBlur(np.random.default_rng(1).uniform(60, 190, (48, 64)), (0, 0), 3)


class Source:
    """Noisy pictures; lost in the middle the first time."""

    def __init__(self, openings_lost: int) -> None:
        self.lost, self.rng = openings_lost, np.random.default_rng(2)

    async def pictures(self):
        lost, self.lost = self.lost > 0, self.lost - 1
        for seq in range(FRAMES):
            if lost and seq == FRAMES // 2:
                raise DeviceLost("unplugged")
            noisy = np.clip(GREY + self.rng.normal(0, 8, GREY.shape), 0, 255).astype(np.uint8)
            jpeg = cv2.imencode(".jpg", noisy, [cv2.IMWRITE_JPEG_QUALITY, 95])[1].tobytes()
            yield Picture(frame=FrameRef(seq=seq, t_capture_ns=seq), t_arrival_ns=seq, jpeg=jpeg)


async def test_the_mean_of_pictures_in_a_row_has_less_noise(tmp_path):
    frames = await pictures_in_a_row(Source(openings_lost=1))
    write_mean(tmp_path / "fisheye.png", [frame.jpeg for frame in frames])
    mean = cv2.imread(str(tmp_path / "fisheye.png"), cv2.IMREAD_GRAYSCALE)
    assert len(frames) == FRAMES
    assert np.std(mean - GREY) < 1.5 * 8 / np.sqrt(FRAMES)


async def test_a_source_that_never_lasts_is_named(monkeypatch):
    monkeypatch.setattr(capture, "PICTURE_S", 0.2)
    with pytest.raises(DeviceLost, match=r"no 16 pictures in a row within 0\.2 s \(unplugged\)"):
        await pictures_in_a_row(Source(openings_lost=10**9))


def test_a_mean_that_cannot_be_written_is_an_error(tmp_path):
    jpeg = cv2.imencode(".jpg", GREY.astype(np.uint8))[1].tobytes()
    with pytest.raises(FileNotFoundError):
        write_mean(tmp_path / "gone" / "fisheye.png", [jpeg])


FIXED = HeadLimits(pan_deg=(-170.0, 170.0), tilt_deg=(-20.0, 90.0), zoom=(1.0, 9999.0))
ENDLESS = HeadLimits(pan_deg=(-180.0, 180.0), tilt_deg=(-90.0, 20.0), zoom=(1.0, 9999.0), endless_pan=True)


@given(st.sampled_from([FIXED, ENDLESS]), st.floats(-80, 80), st.floats(20, 85))
def test_every_look_is_within_the_limits_and_the_range_that_was_asked_for(limits, middle, half):
    looks = wide_plan(limits, (middle - half, middle + half))
    assert all(limits.contains(reading) for reading in looks)
    assert min(reading.pan_deg for reading in looks) == pytest.approx(middle - half)
    assert max(reading.pan_deg for reading in looks) == pytest.approx(middle + half)


@given(st.sampled_from([FIXED, ENDLESS]), st.floats(-179, 179), st.floats(-89, 89))
def test_tele_looks_stay_within_the_limits_wherever_they_are_wanted(limits, pan, tilt):
    looks = tele_plan(limits, ZOOMS, (pan, tilt))
    assert len(looks) == 6 * (len(ZOOMS) - 1)
    assert all(limits.contains(reading) for reading in looks)


def test_an_endless_head_looks_across_its_seam():
    pans = {round(reading.pan_deg) for reading in wide_plan(ENDLESS, (100.0, 260.0))}
    assert {100, 180, -100} <= pans


def test_a_range_that_the_head_does_not_reach_is_refused_with_what_it_reaches():
    with pytest.raises(CalibrationError, match=r"--pan 150,260: the head reaches -170° to 170°"):
        wide_plan(FIXED, (150.0, 260.0))


def test_texture_counts_in_the_middle_of_a_picture():
    rng = np.random.default_rng(1)
    flat = np.full((240, 320), 90, np.uint8)
    textured = flat.copy()
    textured[80:160, 107:213] = rng.integers(0, 255, (80, 106))
    assert texture(flat) == 0
    assert texture(textured) > 50
