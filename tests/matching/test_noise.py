import cv2
import numpy as np
import pytest

from ptzd.matching.noise import SIGMA_FLOOR, noise_sigma, texture_ratio


def gentle(shape=(480, 640)) -> np.ndarray:
    y, x = np.mgrid[: shape[0], : shape[1]]
    return 120 + 50 * np.sin(x / 90) * np.cos(y / 70)


def noisy(picture, sigma, seed=0):
    noise = np.random.default_rng(seed).normal(0, sigma, picture.shape)
    return np.clip(np.round(picture + noise), 0, 255).astype(np.uint8)


@pytest.mark.parametrize("sigma", [2.0, 5.0, 12.0, 25.0])
def test_noise_is_estimated(sigma):
    assert noise_sigma(noisy(gentle(), sigma)) == pytest.approx(sigma, rel=0.15)


def test_texture_does_not_pass_for_noise_when_part_of_the_picture_is_quiet():
    picture = gentle()
    picture[:, :400] += 60 * np.sign(np.sin(np.arange(400) / 1.7))
    assert noise_sigma(noisy(picture, 3.0)) == pytest.approx(3.0, rel=0.3)


@pytest.mark.parametrize("value", [0, 255])
def test_pictures_at_the_end_of_the_scale_have_the_floor(value):
    assert noise_sigma(np.full((480, 640), value, np.uint8)) == SIGMA_FLOOR


def test_tiny_picture_has_the_floor():
    assert noise_sigma(np.full((2, 2), 90, np.uint8)) == SIGMA_FLOOR


@pytest.mark.parametrize("sigma", [1.0, 4.0, 15.0])
def test_noise_and_ramps_are_no_texture(sigma):
    y, x = np.mgrid[:30, :30]
    ratios = [
        texture_ratio(noisy(100 + x + 0.5 * y, sigma, seed).astype(np.float32), max(sigma, SIGMA_FLOOR))
        for seed in range(20)
    ]
    assert max(ratios) < 1.0


def test_more_noise_is_less_texture():
    board = cv2.resize(np.random.default_rng(3).uniform(60, 200, (8, 8)), (32, 32), interpolation=cv2.INTER_CUBIC)
    ratios = [texture_ratio(noisy(board, s).astype(np.float32), s) for s in (1.0, 4.0, 16.0)]
    assert ratios[0] > ratios[1] > ratios[2] > 1.0
