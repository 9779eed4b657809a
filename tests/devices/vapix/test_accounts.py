"""Cameras and accounts as they are: rights by page, redirects, digests that a camera offers and cannot compute."""

from __future__ import annotations

import re

import pytest
from aiohttp import web

from ptzd.config import Limits
from ptzd.devices.vapix.answers import Parameters
from ptzd.devices.vapix.capabilities import surprises
from ptzd.devices.vapix.head import VapixHead
from ptzd.errors import DeviceError, DeviceRefused
from ptzd.model import HeadReading
from ptzd.ports import MoveStalled
from tests.devices.vapix.conftest import FakeCamera

OPTIONAL = ["/axis-cgi/systemready.cgi", "/axis-cgi/basicdeviceinfo.cgi", "/axis-cgi/param.cgi"]


def answering(status: int, text: str = "<html>no</html>", **headers: str):
    async def answer(request: web.Request) -> web.Response:
        return web.Response(status=status, text=text, content_type="text/html", headers=headers)

    return answer


def refusing(camera: FakeCamera):
    """A page that says 401 to a good login."""

    async def answer(request: web.Request) -> web.Response | None:
        if request.headers.get("Authorization") is None:
            return None
        return web.Response(status=401, headers={"WWW-Authenticate": camera.digest_challenge()})

    return answer


@pytest.mark.parametrize("path", OPTIONAL)
@pytest.mark.parametrize("status", [400, 403, 404, 405, 411, 415, 500, 501, 502])
async def test_an_optional_page_may_be_refused_in_any_way(camera, settings_for, clock, path, status):
    camera.faults[path] = answering(status)
    async with VapixHead(settings_for(camera), Limits(), clock) as head:
        assert (await head.describe()).tilt_deg == (-20.0, 90.0)


@pytest.mark.parametrize("path", OPTIONAL)
async def test_a_right_that_is_missing_on_one_page_is_not_a_wrong_password(camera, settings_for, clock, path):
    camera.faults[path] = refusing(camera)
    async with VapixHead(settings_for(camera), Limits(), clock) as head:
        await head.describe()
        await head.describe()


async def test_a_page_that_refuses_what_others_take_says_so(camera, head):
    camera.faults["/axis-cgi/com/ptz.cgi"] = refusing(camera)
    with pytest.raises(DeviceError, match=r"refused on this page \(401\) though others take it"):
        await head.stop()


async def test_a_wrong_password_is_still_tried_once(camera, settings_for, clock, tmp_path):
    wrong = tmp_path / "wrong"
    wrong.write_text("not-it\n")
    async with VapixHead(settings_for(camera, password_file=str(wrong)), Limits(), clock) as head:
        with pytest.raises(DeviceRefused, match="or the password is refused"):
            await head.describe()
    assert camera.refused == 1


@pytest.mark.parametrize("method", ["GET", "POST"])
async def test_an_https_only_camera_is_named_with_the_address_to_set(camera, settings_for, clock, method):
    async def moved(request: web.Request) -> web.Response | None:
        return web.Response(status=301, headers={"Location": f"https://192.0.2.7{request.path_qs}"})

    camera.faults = dict.fromkeys(["/axis-cgi/com/ptz.cgi", *OPTIONAL], moved)
    async with VapixHead(settings_for(camera), Limits(), clock) as head:
        with pytest.raises(DeviceRefused, match=re.escape("https://192.0.2.7; if that is right, set it as ptz.url")):
            await head.describe()


@pytest.mark.parametrize("location", ["http://192.0.2.9:80index.html", "about:blank", "http://[::1/x", ""])
async def test_a_redirect_that_is_no_address_is_a_loss_with_a_name(camera, settings_for, clock, location):
    camera.faults["/axis-cgi/com/ptz.cgi"] = answering(302, Location=location)
    async with VapixHead(settings_for(camera), Limits(), clock) as head:
        with pytest.raises(DeviceError, match=r"ptz\.cgi"):
            await head.describe()


async def test_a_camera_that_offers_sha_256_and_cannot_compute_it_is_asked_with_md5(serve, settings_for, clock):
    def both(camera: FakeCamera) -> list[str]:
        return [camera.digest_challenge().replace("MD5", "SHA-256"), camera.digest_challenge()]

    camera = await serve(FakeCamera(challenge=both))
    async with VapixHead(settings_for(camera), Limits(), clock) as head:
        await head.describe()
    assert camera.refused == 1


async def test_basic_is_not_tried_after_a_refused_digest(serve, settings_for, clock):
    def both(camera: FakeCamera) -> list[str]:
        return [camera.digest_challenge().replace("MD5", "SHA-256"), 'Basic realm="x"']

    camera = await serve(FakeCamera(challenge=both))
    async with VapixHead(settings_for(camera), Limits(), clock) as head:
        with pytest.raises(DeviceRefused, match="password is refused"):
            await head.describe()
    assert camera.refused == 1


def test_digital_ptz_is_told(settings_for, camera):
    found = surprises(Parameters(values={"Properties.PTZ.DigitalPTZ": "yes"}), settings_for(camera), None)
    assert found[0].startswith("Properties.PTZ.DigitalPTZ=yes: ")


async def test_a_tolerance_finer_than_the_head_is_named(serve, settings_for, clock):
    camera = await serve(FakeCamera(clamp=lambda pan, tilt, zoom: (round(pan), round(tilt), zoom)))
    async with VapixHead(settings_for(camera, arrival_tolerance_deg=0.01), Limits(), clock) as head:
        await head.describe()
        with pytest.raises(MoveStalled, match=r"ptz\.arrival_tolerance_deg 0\.01 .* asks for more"):
            await head.move(HeadReading(pan_deg=10.2, tilt_deg=5.0, zoom=1.0))
