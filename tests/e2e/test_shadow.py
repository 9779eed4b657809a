"""A rig in shadow mode, over real sockets: everything is decided, told and logged, and the camera hears of nothing."""

from __future__ import annotations

import asyncio
import json
import sys

import pytest

from ptzd.bus.messages import LeaseRequest
from ptzd.errors import RequestRefused
from ptzd.sim.head import MoveTo


async def run(*command: str) -> tuple[int, str]:
    process = await asyncio.create_subprocess_exec(
        sys.executable, "-m", "ptzd", *command, stdout=asyncio.subprocess.PIPE, stderr=asyncio.subprocess.STDOUT
    )
    said, _ = await process.communicate()
    return process.returncode or 0, said.decode()


@pytest.fixture
async def shadow(make_site, request):
    """A rig whose camera is never told anything, whatever its daemon is asked."""
    site = await make_site()
    site.change(home={"pan_deg": 20.0, "idle_s": getattr(request, "param", 0.5)})
    await site.spawn("--shadow")
    yield site
    await site.end()
    told = [asked for asked in site.rig.camera.asked if "/com/ptz" in asked and "query=" not in asked]
    changed = [asked for asked in site.rig.camera.asked if "param.cgi" in asked and "action=list" not in asked]
    assert told == changed == []
    assert not site.rig.camera.unit.orders or {order.source for order in site.rig.camera.unit.orders} == {"somebody"}
    assert not site.moving


async def test_what_it_would_have_done_is_told_everywhere_and_nothing_moves(shadow) -> None:
    site = shadow
    assert site.status.shadow
    await site.request("gate")
    result = await site.end_of("gate")
    assert result.outcome == "shadow"
    assert "would have taken" in result.reason
    looks = [step.detail for step in site.steps("gate") if step.step == "shadow"]
    assert looks
    assert all(f"pan {look['pan_deg']:.2f}°" in result.reason for look in looks)
    # the way home is imagined too, and the real pose is told beside it
    await site.until_state("HOME")
    await site.until_state("IDLE")
    pose = (await site.client.status()).pose
    assert pose.shadow is not None
    assert abs(pose.shadow.pan_deg - pose.pan_deg) > 15
    code, said = await run("status", "--connect", site.endpoint)
    assert code == 0
    assert "shadow    decides and logs, moves nothing; the head would be at pan" in said
    async with site.client.lease("desk") as kept:
        await site.until_state("MANUAL")
        await kept.go_to(5.0, -20.0)
        await kept.steer(pan_deg_s=10.0)
        await kept.lens(focus="auto")
        with pytest.raises(RequestRefused, match="desk has had the head"):
            await site.client.ask_lease(LeaseRequest(owner="gate"))
    with pytest.raises(RequestRefused, match="the camera was not told to stop") as refused:
        await site.client.control("stop")
    assert refused.value.code == "shadow"
    await site.end()
    (log,) = (site.folder / "log").glob("*.mcap")
    code, said = await run("replay", str(log))
    assert code == 0
    assert "a shadow, nothing moved; it would have:" in said
    assert f"gate: moved to pan {looks[0]['pan_deg']:.2f}°" in said
    assert "rig: moved to pan 20.00°" in said
    code, said = await run("replay", "--json", str(log))
    moves = [wish for wish in json.loads(said)["shadow"] if wish["request"] == "gate"]
    assert [wish["target"]["pan_deg"] for wish in moves] == [look["pan_deg"] for look in looks]
    assert all(0.5 < wish["seconds"] < 10 for wish in moves)
    code, said = await run("log", "info", str(log))
    assert "shadow" in said


@pytest.mark.parametrize("shadow", [600.0], indirect=True, ids=["stays"])
async def test_what_the_camera_shows_where_it_was_to_look_is_believed_and_nothing_else(shadow) -> None:
    """Somebody drives the camera to the first view of the scan: found there, and centred nowhere."""
    site = shadow
    await site.request("first")
    await site.end_of("first")
    look = next(step.detail for step in site.steps("first") if step.step == "shadow")
    site.rig.camera.unit.force(MoveTo(pan=look["pan_deg"], tilt=look["tilt_deg"], zoom=look["zoom"]), "somebody")
    await site.until_truth(lambda: not site.rig.camera.unit.head.busy(site.rig.clock.now_s()))
    await site.request("second")
    result = await site.end_of("second")
    assert result.outcome == "shadow"
    assert any(step.step == "view" for step in site.steps("second"))


async def test_settings_read_again_leave_it_a_shadow(shadow) -> None:
    site = shadow
    site.change(home={"idle_s": 0.7})
    site.process.send_signal(1)
    await site.request("after")
    assert (await site.end_of("after")).outcome == "shadow"
    assert site.status.shadow
