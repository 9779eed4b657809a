"""A running rig among zones, over real sockets; where the axis was and what the pictures show is told by the simulator.

The private window glows in a colour that is nowhere else in the scene: one pixel of it anywhere would tell.
"""

from __future__ import annotations

import asyncio
import dataclasses
import math

import numpy as np
import pytest
import yaml

from ptzd.errors import RequestRefused
from ptzd.geometry.head import HeadModel
from ptzd.geometry.outline import Outline
from ptzd.geometry.sphere import bearing, pan_tilt
from ptzd.geometry.zones import covers
from ptzd.jpeg.pixels import decode_bgr
from ptzd.log.reader import LogReader
from ptzd.log.topics import PTZ_IMAGE
from ptzd.model import HeadReading
from ptzd.sim.scene import Scene, load_scene

FAR = [1000.0, math.inf]
GLOW = (255, 0, 255)


def square(pan_deg: float, tilt_deg: float, half_deg: float) -> list[list[float]]:
    left, right, low, high = pan_deg - half_deg, pan_deg + half_deg, tilt_deg - half_deg, tilt_deg + half_deg
    return [[left, low], [right, low], [right, high], [left, high]]


def outline_of(corners: list[list[float]]) -> tuple[Outline, ...]:
    pans, tilts = np.radians(np.array(corners)).T
    return (Outline(bearing(pans, tilts)),)


def target_deg(scene: Scene) -> tuple[float, float]:
    pan, tilt = pan_tilt(scene.demo_boxes[0].truth.bearing_head)
    return math.degrees(float(pan)), math.degrees(float(tilt))


def window(scene: Scene) -> list[list[float]]:
    """Beside the target, in every wide picture of it."""
    pan, tilt = target_deg(scene)
    return square(pan + 14.0, tilt + 3.0, 3.0)


class Glowing(Scene):
    """The scene as the PTZ sees it, with a window that glows."""

    def sample_ptz(self, rays_head, pixel_angle_rad):
        picture = super().sample_ptz(rays_head, pixel_angle_rad)
        inside = covers(outline_of(window(self)), rays_head.reshape(-1, 3)).reshape(rays_head.shape[:2])
        picture[inside] = GLOW
        return picture


@pytest.fixture(scope="session")
def hall() -> Scene:
    plain = load_scene("pair_hall")
    return Glowing(**{field.name: getattr(plain, field.name) for field in dataclasses.fields(plain)})


def glows(jpeg: bytes) -> int:
    """Pixels of a picture in the window's colour."""
    blue, green, red = np.moveaxis(decode_bgr(jpeg).astype(int), -1, 0)
    return int(((np.minimum(blue, red) - green) > 60).sum())


def axes_since(site, since_s: float) -> np.ndarray:
    """True directions of the optical axis, ``(n, 3)``."""
    head: HeadModel = site.rig.head
    poses = [site.rig.camera.unit.head.optical(float(t_s)) for t_s in np.arange(since_s, site.rig.clock.now_s(), 0.01)]
    readings = [HeadReading(pan_deg=pose.pan_deg, tilt_deg=pose.tilt_deg, zoom=1.0) for pose in poses]
    return np.array([head.head_from_camera(*head.pan_tilt_from_vapix(reading))[:, 2] for reading in readings])


async def follow(site, shown: list[bytes]) -> None:
    """Keep every picture of the PTZ that goes over the bus."""
    async for image in site.client.images("ptz"):
        shown.extend((image.jpeg,))


async def test_around_beside_and_never_through(make_site, hall) -> None:
    site = await make_site()
    start = HeadReading(pan_deg=0.0, tilt_deg=0.0, zoom=1.0)
    home = [math.degrees(angle) for angle in site.rig.head.pan_tilt_from_vapix(start)]
    there = target_deg(hall)
    closed = square((home[0] + there[0]) / 2, (home[1] + there[1]) / 2, 3.0)
    zones = [
        {"name": "lamp", "kind": "no_go", "frame": "head", "corners_deg": closed, "range_m": FAR},
        {"name": "window", "kind": "privacy", "frame": "head", "corners_deg": window(hall), "range_m": FAR},
    ]
    (site.folder / "zones.yaml").write_text(yaml.safe_dump({"zones": zones}))
    document = yaml.safe_load(site.config.read_text())
    site.config.write_text(yaml.safe_dump({**document, "zones": "zones.yaml"}))
    await site.start()
    since_s = site.rig.clock.now_s()
    shown: list[bytes] = []

    looking = asyncio.create_task(follow(site, shown))
    result = await site.lock("a", hold_s=0.0)
    assert result.outcome == "locked"
    async with site.client.lease("desk") as kept:
        await site.until_state("MANUAL")
        pan, tilt = (sum(corner[axis] for corner in closed) / 4 for axis in (0, 1))
        with pytest.raises(RequestRefused, match="in the no_go zone lamp") as refused:
            await kept.go_to(pan, tilt)
        assert refused.value.code == "zone"
    await site.until_state("HOME")
    await site.until_state("IDLE")
    looking.cancel()
    await asyncio.gather(looking, return_exceptions=True)
    axes = axes_since(site, since_s)
    assert not covers(outline_of(closed), axes).any()
    assert math.degrees(math.acos(min(float((axes @ bearing(*np.radians(there))).max()), 1.0))) < 2.0, "it was there"
    assert shown
    assert [glows(jpeg) for jpeg in shown] == [0] * len(shown)
    await site.end()
    site.serving = None
    kept_pictures = 0
    for path in sorted((site.folder / "log").glob("*.mcap")):
        with LogReader(path) as reader:
            for entry in reader.entries((PTZ_IMAGE,)):
                kept_pictures += 1
                assert glows(reader.image(entry).data) == 0
    assert kept_pictures > 10


async def test_the_glow_would_be_seen(make_site, hall) -> None:
    """Without the zone the same pictures show the window: the law above is no empty one."""
    site = await make_site()
    await site.start()
    shown: list[bytes] = []

    looking = asyncio.create_task(follow(site, shown))
    await site.lock("a", hold_s=0.0)
    looking.cancel()
    await asyncio.gather(looking, return_exceptions=True)
    assert max(map(glows, shown)) > 500
