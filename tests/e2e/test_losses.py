"""A device that goes away in the middle of work: the request hears why, and everything heals without a restart."""

from __future__ import annotations

import pytest

from ptzd.errors import RequestRefused
from ptzd.sim.faults import Fault, FaultKind


async def scanning(site) -> None:
    """A request whose scan has the head on its way."""
    await site.request("first", hold_s=30.0)
    await site.until_state("SCAN")
    await site.until_truth(lambda: site.moving)


async def refused_and_recovered(site) -> None:
    """While the device is gone requests are refused with the reason; afterwards one locks."""
    with pytest.raises(RequestRefused) as refused:
        await site.client.request(box=site.box, id="meanwhile")
    assert refused.value.code == "device_lost"
    assert "FAULT" in refused.value.message


async def test_a_camera_that_dies_in_a_scan(make_site) -> None:
    site = await make_site(boot_s=2.0)
    await site.start()
    await scanning(site)
    site.rig.camera.reboot()
    result = await site.end_of("first")
    assert result.outcome == "device_lost"
    assert result.reason.startswith("ptz: ")
    assert site.rig.camera_url in result.reason
    await site.until_state("FAULT")
    await refused_and_recovered(site)
    await site.until_state("IDLE")
    await site.lock("after")


async def test_a_fisheye_that_is_unplugged_in_a_scan(make_site) -> None:
    site = await make_site()
    await site.start()
    await scanning(site)
    await site.rig.fisheye.unplug()
    result = await site.end_of("first")
    assert result.outcome == "device_lost"
    assert result.reason.startswith("fisheye: ")
    await site.until_truth(lambda: not site.moving)
    orders = site.orders
    await site.until_state("FAULT")
    await refused_and_recovered(site)
    assert site.orders == orders, "nothing moves while a device is lost"
    await site.rig.fisheye.plug_in()
    await site.until_state("IDLE")
    await site.lock("after")


async def test_a_camera_that_is_away_at_the_start_is_waited_for(make_site) -> None:
    site = await make_site()
    fault = Fault(kind=FaultKind.STATUS, status=503)
    site.rig.inject(fault)
    await site.start(wait_ready=False)
    await site.until(lambda: site.status.fisheye == "well" and "503" in site.status.ptz)
    assert not site.ready.is_set()
    assert site.state == "STARTING"
    with pytest.raises(RequestRefused, match="STARTING"):
        await site.client.request(box=site.box, id="early")
    site.rig.camera.faults.clear()
    await site.until_state("IDLE")
    await site.lock("after")


@pytest.mark.parametrize("device", ["ptz", "fisheye"])
async def test_pictures_that_are_cut_short_are_skipped_and_counted(make_site, device: str) -> None:
    site = await make_site()
    await site.start()
    await site.request("first", hold_s=1.0)
    site.rig.inject(Fault(kind=FaultKind.TRUNCATE, count=6, device=device))
    assert (await site.end_of("first")).outcome == "locked"
    if device == "fisheye":
        await site.until(lambda: site.status.devices["fisheye_lost"] >= 6)


async def test_nothing_but_cut_pictures_is_a_lost_fisheye(make_site) -> None:
    site = await make_site()
    site.change(fisheye={"stall_s": 3.0})
    await site.start()
    await scanning(site)
    fault = Fault(kind=FaultKind.TRUNCATE, device="fisheye")
    site.rig.inject(fault)
    result = await site.end_of("first")
    assert result.outcome == "device_lost"
    assert "no complete picture" in result.reason
    await site.until_truth(lambda: not site.moving)
    site.rig.fisheye.faults.clear()
    await site.until_state("IDLE")
    await site.lock("after")
