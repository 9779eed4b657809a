"""The fisheye's picture for a calibration without a board: a mean of several, of a source that may stumble."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from ptzd.app import calibrate_capture
from ptzd.app.calibrate_capture import FRAMES, pictures_in_a_row, write_mean
from ptzd.errors import DeviceLost
from ptzd.model import FrameRef
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
    monkeypatch.setattr(calibrate_capture, "PICTURE_S", 0.2)
    with pytest.raises(DeviceLost, match=r"no 16 pictures in a row within 0\.2 s \(unplugged\)"):
        await pictures_in_a_row(Source(openings_lost=10**9))


def test_a_mean_that_cannot_be_written_is_an_error(tmp_path):
    jpeg = cv2.imencode(".jpg", GREY.astype(np.uint8))[1].tobytes()
    with pytest.raises(FileNotFoundError):
        write_mean(tmp_path / "gone" / "fisheye.png", [jpeg])
