"""A head that is bumped, a gear that slips, a motor that takes no moves: told by a running rig, over real sockets."""

from __future__ import annotations

import asyncio
import sys

import pytest

from ptzd.sim.faults import Fault, FaultKind


@pytest.fixture
async def rig(make_site):
    site = await make_site(boot_s=1.0)
    site.change(ptz={"stall_s": 5.0}, home={"idle_s": 0.2})
    await site.start()
    return site


async def rests(site) -> None:
    """Long enough for a look."""
    told_ns = site.status.t_ns
    await site.until(lambda: not site.status.pose.moving and site.status.t_ns > told_ns + 3_000_000_000)


async def rests_at_home(site) -> None:
    await site.until_state("IDLE")
    await site.until_truth(site.rig.camera.unit.at_home)
    await rests(site)


async def by_hand(site, *pans: float) -> None:
    """To one place after the other, with time for a look at each."""
    async with site.client.lease("desk") as kept:
        await site.until_state("MANUAL")
        for pan in pans:
            await kept.go_to(pan, -30.0)
            await rests(site)


async def test_a_bumped_head_is_told_in_status_and_results_and_a_restart_heals_it(rig) -> None:
    await rig.lock("before")
    await rests_at_home(rig)
    rig.rig.inject(Fault(kind=FaultKind.KNOCK, pan=3.0, tilt=1.0))
    await rig.request("during")
    await rig.end_of("during")
    await rests_at_home(rig)
    await rig.until(lambda: rig.status.doubt != "")
    assert rig.status.doubt.startswith("lost its zero: pictures look +")
    off_pan, off_tilt = (float(word) for word in rig.status.doubt.replace("°", "").split() if word[0] in "+-")
    assert off_pan == pytest.approx(3.0, abs=0.3)
    assert off_tilt == pytest.approx(1.0, abs=0.3)
    said = await status_in_words(rig)
    assert "head      lost its zero" in said
    await rig.request("after")
    assert "beware, the head is in doubt: lost its zero" in (await rig.end_of("after")).reason
    rig.rig.inject(Fault(kind=FaultKind.REBOOT))
    await rig.until_state("FAULT")
    await rig.until(lambda: rig.status.doubt == "")
    await rig.lock("healed")


async def test_a_gear_that_slips_is_told_and_a_restart_heals_it(rig) -> None:
    await rests_at_home(rig)
    rig.rig.inject(Fault(kind=FaultKind.STUCK))
    await by_hand(rig, 12.0, -10.0, 12.0)
    await rig.until(lambda: rig.status.doubt.startswith("stuck: reported at pan "))
    rig.rig.inject(Fault(kind=FaultKind.REBOOT))
    await rig.until_state("FAULT")
    await rig.until_state("IDLE")
    await by_hand(rig, 6.0, -4.0, 6.0)
    await rig.until(lambda: rig.status.doubt == "")


async def test_a_motor_that_takes_no_moves_is_told_from_its_reports(rig) -> None:
    await rests_at_home(rig)
    locked = {"kind": FaultKind.PARAMETER, "name": "PTZ.Various.V1.Locked"}
    rig.rig.inject(Fault(value="true", **locked))
    await rig.until_truth(lambda: rig.rig.camera.unit.flag("PTZ.Various.V1.Locked"))
    for name in ("one", "two"):
        await rig.request(name)
        assert (await rig.end_of(name)).outcome == "unreachable"
    await rig.until(lambda: rig.status.doubt.startswith("stuck: told to go to pan "))
    rig.rig.inject(Fault(value="false", **locked))
    await rig.until_truth(lambda: not rig.rig.camera.unit.flag("PTZ.Various.V1.Locked"))
    await rig.lock("again")
    await rig.until(lambda: rig.status.doubt == "")


async def status_in_words(site) -> str:
    process = await asyncio.create_subprocess_exec(
        sys.executable, "-m", "ptzd", "status", "--connect", site.endpoint, stdout=asyncio.subprocess.PIPE
    )
    return (await process.communicate())[0].decode()
