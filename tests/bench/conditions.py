"""The rows of the accuracy table."""

from __future__ import annotations

import numpy as np

from tests.bench.cases import Condition

PLANES = ("planar", "slightly_planar", "non_planar", "occluded", "small", "weak_texture", "textured", "repetitive")


def mild_light(picture: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Gain 0.7, gamma 1.4, a ramp of ±30 % in a random direction."""
    return _light(picture, rng, 0.8, 1.4, 0.3)


def strong_light(picture: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Gain 0.45, gamma 2.2, a ramp of ±60 %."""
    return _light(picture, rng, 0.6, 2.2, 0.6)


def bright_light(picture: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Overexposed: gain 1.8, gamma 0.6, the brightest parts burnt out."""
    return _light(picture, rng, 1.8, 0.6, 0.2)


def reversed_contrast(picture: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    return 255.0 - 0.8 * picture


def _light(picture: np.ndarray, rng: np.random.Generator, gain: float, gamma: float, ramp: float) -> np.ndarray:
    height, width = picture.shape
    angle = rng.uniform(0, 2 * np.pi)
    x, y = np.meshgrid(np.linspace(-1, 1, width), np.linspace(-1, 1, height))
    shade = 1.0 + ramp * (np.cos(angle) * x + np.sin(angle) * y) / 1.4
    return np.clip(255.0 * gain * shade * (np.clip(picture, 0, 255) / 255.0) ** gamma, 0, 255)


CONDITIONS: tuple[Condition, ...] = (
    Condition(name="clean"),
    Condition(name="planar", group="surface", paper="0.58", kinds=("planar",)),
    Condition(name="slightly planar", group="surface", paper="0.60", kinds=("slightly_planar",)),
    Condition(name="non-planar", group="surface", paper="7.34", kinds=("non_planar",)),
    Condition(name="occluded in scene", group="surface", kinds=("occluded",)),
    Condition(name="small", group="surface", kinds=("small",)),
    Condition(name="weak texture", group="surface", kinds=("weak_texture",)),
    Condition(name="repetitive", group="surface", kinds=("repetitive",)),
    Condition(name="noise var 10.2", group="noise", paper="3.96", noise=10.2**0.5),
    Condition(name="noise var 20.4", group="noise", paper="5.66", noise=20.4**0.5),
    Condition(name="noise var 35.7", group="noise", paper="6.07", noise=35.7**0.5),
    Condition(name="noise sigma 25", group="noise", noise=25.0),
    Condition(name="hfov 40", group="hfov", paper="2.5-4", hfov_deg=40.0),
    Condition(name="hfov 50", group="hfov", paper="2.5-4", hfov_deg=50.0),
    Condition(name="hfov 65", group="hfov", paper="2.5-4", hfov_deg=65.0),
    Condition(name="hfov 80", group="hfov", paper="2.5-4", hfov_deg=80.0),
    Condition(name="zoom x5", group="zoom", hfov_deg=13.2, aimed_deg=1.0),
    Condition(name="fisheye 1280x960", group="resolution", fisheye_scale=2),
    Condition(name="light mild", group="light", light=mild_light),
    Condition(name="light strong", group="light", light=strong_light),
    Condition(name="light bright", group="light", light=bright_light),
    Condition(name="contrast reversed", group="light", light=reversed_contrast),
    Condition(name="occlusion 10 %", group="occlusion", occlusion=0.1),
    Condition(name="occlusion 20 %", group="occlusion", occlusion=0.2),
    Condition(name="occlusion 30 %", group="occlusion", occlusion=0.3),
    Condition(name="occlusion 40 %", group="occlusion", occlusion=0.4),
    Condition(name="occlusion 50 %", group="occlusion", occlusion=0.5),
    Condition(name="extrinsics 0.2", group="extrinsics", extrinsics_deg=0.2),
    Condition(name="extrinsics 0.7", group="extrinsics", extrinsics_deg=0.7),
    Condition(name="extrinsics 1.0", group="extrinsics", extrinsics_deg=1.0, band_deg=1.3),
    Condition(name="extrinsics 2.0", group="extrinsics", extrinsics_deg=2.0, band_deg=2.5),
    Condition(name="verify", group="verify", hfov_deg=40.0, aimed_deg=0.3, narrow=0.1, band_deg=0.4),
    Condition(name="verify zoomed", group="verify", hfov_deg=13.2, aimed_deg=0.3, narrow=0.1, band_deg=0.4),
    Condition(name="absent", group="refusal", absent=True),
    Condition(
        name="verify absent",
        group="refusal",
        absent=True,
        hfov_deg=40.0,
        aimed_deg=0.3,
        narrow=0.1,
        band_deg=0.4,
    ),
    Condition(name="texture-free", group="refusal", kinds=("texture_free",)),
)
