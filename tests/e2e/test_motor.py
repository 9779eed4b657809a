"""The motor of a running rig: counted by what the camera reports, kept over a restart, spared by its budget."""

from __future__ import annotations

import itertools
import math

import pytest

from ptzd.app.motor_file import read_travel
from ptzd.errors import RequestRefused


async def test_what_it_has_gone_is_what_the_encoders_went_and_outlives_the_daemon(make_site) -> None:
    site = await make_site()
    site.change(home={"pan_deg": 15.0}, motor={"dead_zone_deg": 0.05})
    await site.spawn()
    await site.lock("gate")
    await site.until_state("HOME")
    await site.until_state("IDLE")
    status = await site.client.status()
    assert status.motor.moves >= 2
    # at least from the start to home; and no more than the moves that were sent can explain
    assert status.motor.pan_deg >= 14.9
    orders = [record.order for record in site.rig.camera.unit.orders]
    places = [0.0, *(order.pan for order in orders if getattr(order, "pan", None) is not None)]
    gone = sum(abs(after - before) for before, after in itertools.pairwise(places))
    assert status.motor.pan_deg == pytest.approx(gone, abs=0.2 * len(places))
    site.process.terminate()
    await site.process.wait()
    kept = read_travel(site.folder / "log" / "motor.json")
    assert kept.moves == status.motor.moves
    assert math.isclose(kept.pan_deg, status.motor.pan_deg, abs_tol=0.1)


async def test_a_spent_budget_refuses_by_name_and_lets_people_through(make_site) -> None:
    site = await make_site()
    site.change(motor={"moves_per_hour": 2, "reserve": 0.5})
    await site.start()
    await site.lock("gate")
    with pytest.raises(RequestRefused, match=r"the motor's budget is spent \(motor.moves_per_hour: .* of 2") as refused:
        await site.client.request(id="next", box=site.box, hold_s=0.0)
    assert refused.value.code == "budget"
    async with site.client.lease("desk"):
        await site.until_state("MANUAL")
        await site.lock("mine", by="desk")
    assert (await site.client.status()).motor.moves_per_hour == 2
