"""A person moves the head of a running rig by hand, over real sockets; what it does is told by the simulator."""

from __future__ import annotations

import asyncio
import math
import sys

import pytest

from ptzd.bus.by_hand import ViewPose
from ptzd.errors import RequestRefused
from ptzd.model import HeadReading


def pose(site):
    """Where the optics truly point, in the camera's units."""
    rig = site.rig
    return rig.camera.unit.head.optical(rig.clock.now_s())


def turned_deg(site, before, after) -> float:
    """Angle between two directions of the optical axis."""
    head = site.rig.head
    axes = [
        head.head_from_camera(*head.pan_tilt_from_vapix(HeadReading(pan_deg=p.pan_deg, tilt_deg=p.tilt_deg, zoom=1)))
        for p in (before, after)
    ]
    return math.degrees(math.acos(float(axes[0][:, 2] @ axes[1][:, 2])))


def moving(site) -> bool:
    rig = site.rig
    return rig.camera.unit.head.moving(rig.clock.now_s())


async def at_rest(site, since: int) -> None:
    """Until the rig says that his hand moved, after so many words of it, and rests."""
    await site.until(lambda: any(item.phase in {"moving", "steering"} for item in site.statuses[since:]))
    await site.until(lambda: site.status.state == "MANUAL" and site.status.phase == "")


async def test_what_is_clicked_on_comes_to_the_centre(site) -> None:
    async with site.client.lease("desk") as kept:
        await site.until_state("MANUAL")
        async for image in site.client.images("ptz"):
            shown = image.attachment
            break
        picture = ViewPose(pan_deg=shown.pan_deg, tilt_deg=shown.tilt_deg, zoom=shown.zoom)
        size = (shown.w, shown.h)
        before, since = pose(site), len(site.statuses)
        told = await kept.centre(0.75 * size[0], 0.5 * size[1], picture=picture)
        await at_rest(site, since)
        after, since = pose(site), len(site.statuses)
        # a quarter of a picture that is hfov wide, at the middle of its height
        quarter_deg = math.degrees(math.atan(0.5 * math.tan(math.radians(shown.hfov_deg / 2))))
        assert turned_deg(site, before, after) == pytest.approx(quarter_deg, rel=0.05)
        framed = await kept.frame((0.4 * size[0], 0.4 * size[1], 0.1 * size[0], 0.1 * size[1]))
        assert framed.hfov_deg < told.hfov_deg / 3
        await at_rest(site, since)
        assert pose(site).zoom == pytest.approx(framed.zoom, abs=1)
        with pytest.raises(RequestRefused, match="its limits are pan") as refused:
            await kept.go_to(0.0, 89.0)
        assert refused.value.code == "unreachable"
    with pytest.raises(RequestRefused, match=r"take it \(again\)"):
        await kept.go_by(1.0, 0.0)


async def test_steered_on_the_command_line_and_killed_in_the_middle_it_rests(site) -> None:
    ptzd = (sys.executable, "-m", "ptzd")
    there = ("--connect", site.endpoint)
    keeper = await asyncio.create_subprocess_exec(*ptzd, "lease", "desk", *there, stdout=asyncio.subprocess.PIPE)
    try:
        await keeper.stdout.readline()
        await site.until_state("MANUAL")
        steering = await asyncio.create_subprocess_exec(
            *ptzd, "move", "desk", "--speed", "-5", "2", "0", "--for", "600", *there, stdout=asyncio.subprocess.PIPE
        )
        assert b"at pan -5.00" in await steering.stdout.readline()
        await site.until(lambda: site.status.phase == "steering")
        await site.until_truth(lambda: moving(site))
        steering.kill()
        await steering.wait()
        await at_rest(site, 0)
        assert not moving(site)
    finally:
        keeper.kill()
        await keeper.wait()
    await site.until(lambda: site.status.lease is None)
    assert not moving(site) or site.status.state == "HOME"


async def test_a_move_on_the_command_line(site) -> None:
    ptzd = (sys.executable, "-m", "ptzd")
    there = ("--connect", site.endpoint)
    alone = await asyncio.create_subprocess_exec(
        *ptzd, "move", "desk", "--by", "-5", "1", *there, stderr=asyncio.subprocess.PIPE
    )
    assert b"take it" in (await alone.communicate())[1]
    assert alone.returncode != 0
    async with site.client.lease("desk"):
        before, since = pose(site), len(site.statuses)
        move = await asyncio.create_subprocess_exec(
            *ptzd, "move", "desk", "--by", "-5", "1", *there, stdout=asyncio.subprocess.PIPE
        )
        assert b"to pan " in (await move.communicate())[0]
        await at_rest(site, since)
        assert pose(site).pan_deg - before.pan_deg == pytest.approx(-5.0, abs=0.1)
        assert pose(site).tilt_deg - before.tilt_deg == pytest.approx(1.0, abs=0.1)


async def test_focus_by_hand_until_he_gives_it_back(site) -> None:
    switches, levels = site.rig.camera.unit.switches, site.rig.camera.unit.levels
    async with site.client.lease("desk") as kept:
        told = await kept.lens(focus=2000, iris="auto")
        assert (told.focus, told.iris) == (2000, "auto")
        assert (switches["autofocus"], levels["focus"], switches["autoiris"]) == ("off", 2000, "on")
        with pytest.raises(RequestRefused, match="the camera has 770 to 9999"):
            await kept.lens(focus=5)
    await site.until_truth(lambda: switches["autofocus"] == "on")
