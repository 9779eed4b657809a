"""Rules of a client that cameras taught others, over a socket, where no other test of this folder shows them."""

from __future__ import annotations

import asyncio

import pytest
from aiohttp import web

from ptzd.config import Limits
from ptzd.devices.vapix.head import VapixHead
from ptzd.errors import DeviceGarbled, DeviceRefused
from ptzd.model import HeadReading
from ptzd.runtime.clock import SteadyClock
from ptzd.sim.camera import AxisCamera
from ptzd.sim.clock import WallClock
from ptzd.sim.profile import PROFILES, profile
from ptzd.sim.rig_truth import head_model
from ptzd.sim.scene import load_scene
from ptzd.sim.settings import SimSettings

PTZ = "/axis-cgi/com/ptz.cgi"
SURPRISES = {
    "PTZ.Various.V1.ReturnToOverview": "30",
    "PTZ.Various.V1.CtlQueueing": "true",
    "PTZ.Various.V1.TiltEnabled": "false",
    "PTZ.UserAdv.U1.AutoFlip": "true",
    "PTZ.UserAdv.U1.CameraHousingConfiguration": "inverted",
    "PTZ.UserAdv.U1.ImageFreeze": "auto",
    "PTZ.UserAdv.U1.MoveSpeed": "60",
    "Image.I0.Appearance.Rotation": "180",
    "GuardTour.G0.Running": "yes",
}


def commands(camera, answer):
    """Answer commands so, queries as usual."""

    async def fault(request):
        return None if "query" in request.query else answer(request)

    camera.faults[PTZ] = fault


def at(pan: float, tilt: float = 10.0, zoom: float = 1.0) -> HeadReading:
    return HeadReading(pan_deg=pan, tilt_deg=tilt, zoom=zoom)


async def test_an_empty_200_to_a_command_is_a_yes(head, camera):
    def older_driver(request):
        camera.go(*(float(request.query[name]) for name in ("pan", "tilt", "zoom")))
        return web.Response(status=200, text="")

    commands(camera, older_driver)
    assert await head.move(at(20)) == at(20)


@pytest.mark.parametrize(
    ("text", "kind", "message"),
    [
        ("Error:\r\npan: invalid value\r\n", DeviceRefused, "the camera says: 'Error: pan: invalid value'"),
        ("# Error: no\n", DeviceRefused, "the camera says"),
        ("pan=20\r\n", DeviceGarbled, "expected an empty answer to a command"),
        ("<html><body>busy</body></html>", DeviceGarbled, "got HTML|expected an empty answer"),
    ],
)
async def test_a_200_with_a_body_to_a_command_is_a_no(head, camera, text, kind, message):
    commands(camera, lambda _: web.Response(text=text))
    with pytest.raises(kind, match=message):
        await head.move(at(20))


@pytest.mark.parametrize(
    ("target", "pan", "zoom"),
    [(at(1e-7), "0.0000", "1"), (at(-1e-5), "-0.0000", "1"), (at(1 / 3, zoom=1.4), "0.3333", "1")],
)
async def test_numbers_have_four_decimals_no_exponent_and_zoom_none(head, camera, target, pan, zoom):
    await head.move(target)
    assert (camera.commands[-1]["pan"], camera.commands[-1]["zoom"]) == (pan, zoom)


async def test_zero_is_a_place_like_any_other(head, camera):
    await head.move(at(15, 15))
    assert await head.move(at(0, 0)) == at(0, 0)
    assert (camera.commands[-1]["pan"], camera.commands[-1]["tilt"]) == ("0.0000", "0.0000")


async def test_reports_that_take_their_time_still_prove_an_arrival(camera, settings_for, clock):
    async with VapixHead(settings_for(camera, stall_s=10.0), Limits(), clock) as head:
        await head.describe()

        async def slow(request):
            if "query" in request.query:
                await asyncio.sleep(2.0)

        camera.faults[PTZ] = slow
        assert await head.move(at(5)) == at(5)


async def test_a_stop_is_sent_again_until_the_camera_takes_it(head, camera):
    refusals = iter(range(3))
    commands(camera, lambda _: web.Response(status=503) if next(refusals, None) is not None else None)
    await head.stop()
    assert [sorted(command) for command in camera.commands[-2:]] == [
        ["camera", "continuouspantiltmove", "continuouszoommove"],
        ["camera", "move"],
    ]
    assert next(refusals, None) is None


async def test_nothing_is_ever_sent_that_goes_on_by_itself(head, camera):
    """So there is nothing that a dead-man would have to end."""
    await head.move(at(20))
    await head.stop()
    await head.move(at(-20, 30, 900))
    continuous = [value for command in camera.commands for name, value in command.items() if "continuous" in name]
    assert set(continuous) == {"0,0", "0"}
    assert not [name for command in camera.commands for name in command if name.startswith("r")]


@pytest.fixture(scope="module")
def hall():
    return load_scene("pair_hall")


@pytest.mark.parametrize("name", sorted(PROFILES))
async def test_a_simulated_camera_is_warned_about_by_name(settings_for, password_file, hall, name):
    settings, kind = SimSettings(profile=name), profile(name)
    password_file.write_text(settings.password)
    camera = AxisCamera(settings, hall, head_model(kind.mount, kind), WallClock())
    async with camera:
        camera.unit.parameters |= SURPRISES
        changes = {"size_px": (160, 120), "stall_s": 5.0}
        async with VapixHead(settings_for(camera, **changes), Limits(), SteadyClock()) as head:
            await head.describe()
            told = {warning.partition("=")[0] for warning in head.capabilities.warnings}
            assert told == (set(SURPRISES) - {"PTZ.UserAdv.U1.MoveSpeed"}) | {"speed"}
            assert head.capabilities.attributes.max_speed_deg_s == (None if name == "old214" else 150.0)
            assert head.capabilities.hfov_deg == (kind.field_angle[0] / 10, kind.field_angle[1] / 10)
