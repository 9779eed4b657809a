from __future__ import annotations

import asyncio
import logging
import traceback

import pytest
from aiohttp import web

from ptzd.devices.vapix import requests
from ptzd.devices.vapix.address import Address
from ptzd.devices.vapix.client import CameraClient
from ptzd.devices.vapix.credentials import Credentials, Secret
from ptzd.errors import ConfigError, DeviceGarbled, DeviceLost, DeviceRefused
from ptzd.model import HeadReading

PASSWORD = "orange-Bicycle_77"
GOOD = Credentials(user="ptzd", password=Secret(PASSWORD))
POSITION = requests.position(1)
BASIC = 'Basic realm="AXIS_ACCC8E000000"'
PTZ = "/axis-cgi/com/ptz.cgi"


@pytest.fixture
async def client_of(clock):
    clients = []

    async def make(camera, *, credentials=GOOD, pause_s=60.0, **address):
        client = CameraClient(Address(url=camera.url, setting="ptz", **address), clock, refusal_pause_s=pause_s)
        client.use(credentials)
        clients.append(await client.__aenter__())
        return client

    yield make
    for client in clients:
        await client.__aexit__(None, None, None)


async def test_one_challenge_serves_all_requests(camera, client_of):
    client = await client_of(camera)
    for _ in range(20):
        assert await client.send(POSITION) == HeadReading(pan_deg=0, tilt_deg=0, zoom=1)
    await asyncio.gather(*(client.send(POSITION) for _ in range(20)))
    assert (camera.challenged, camera.refused) == (1, 0)


@pytest.mark.parametrize("basic_first", [True, False])
async def test_both_orders_of_challenges(camera, client_of, basic_first):
    camera.challenge = lambda cam: [BASIC, cam.digest_challenge()][:: 1 if basic_first else -1]
    await (await client_of(camera)).send(POSITION)
    assert camera.refused == 0


async def test_basic_over_http_only_when_allowed(camera, client_of):
    camera.challenge = lambda _: [BASIC]
    with pytest.raises(DeviceRefused, match="allow_basic_over_http"):
        await (await client_of(camera)).send(POSITION)
    await (await client_of(camera, allow_basic_over_http=True)).send(POSITION)


@pytest.mark.parametrize("stale", [True, False])
async def test_an_expired_nonce_costs_one_more_challenge(camera, client_of, stale):
    client = await client_of(camera)
    await client.send(POSITION)
    camera.nonce = "n1"
    camera.challenge = lambda cam: [cam.digest_challenge(stale)]
    await asyncio.gather(*(client.send(POSITION) for _ in range(5)))
    await client.send(POSITION)
    assert camera.challenged == 1


async def test_a_wrong_password_is_tried_once_a_minute(camera, client_of):
    client = await client_of(camera, credentials=Credentials(user="ptzd", password=Secret("wrong")))
    for _ in range(10):
        with pytest.raises(DeviceRefused, match=r"user 'ptzd' or the password is refused \(401\)"):
            await client.send(POSITION)
    assert (camera.refused, len(camera.seen)) == (1, 2)
    client.use(GOOD)
    await client.send(POSITION)


async def test_after_the_pause_it_is_tried_again(camera, client_of):
    client = await client_of(camera, credentials=Credentials(user="ptzd", password=Secret("wrong")), pause_s=0.05)
    for _ in range(3):
        with pytest.raises(DeviceRefused):
            await client.send(POSITION)
        await asyncio.sleep(0.06)
    assert camera.refused == 3


async def test_a_missing_right_blocks_its_page_only(camera, client_of):
    client = await client_of(camera)

    async def forbidden(_request):
        return web.Response(status=403)

    camera.faults["/axis-cgi/param.cgi"] = forbidden
    for _ in range(3):
        with pytest.raises(DeviceRefused, match="has no right to this page"):
            await client.send(requests.parameters("PTZ"))
    assert sum("param.cgi" in path for path in camera.seen) == 1
    await client.send(POSITION)


def answer(**kwargs):
    async def fault(_request):
        return web.Response(**kwargs)

    return fault


async def reset(request):
    request.transport.abort()
    raise ConnectionResetError


async def hang(_request):
    await asyncio.sleep(30)


FAULTS = {
    "503": (answer(status=503, headers={"Retry-After": "7"}), DeviceLost, r"overloaded or starting \(503\)"),
    "500": (answer(status=500), DeviceLost, r"fails \(500\)"),
    "404": (answer(status=404), DeviceRefused, r"does not offer this \(404\)"),
    "418": (answer(status=418), DeviceRefused, "answers 418"),
    "html": (answer(text="<html>hello</html>", content_type="text/html"), DeviceGarbled, "got HTML"),
    "error": (answer(text="Error:\r\nPTZ disabled\r\n"), DeviceRefused, "the camera says: 'Error: PTZ disabled'"),
    "garbage": (answer(text="pan=n/a#\r\ntilt=n/a#\r\nzoom=n/a#\r\n"), DeviceGarbled, "is no number"),
    "empty": (answer(text=""), DeviceGarbled, "no key at all"),
    "huge": (answer(body=bytes(1_200_000)), DeviceGarbled, "longer than"),
    "elsewhere": (
        answer(status=302, headers={"Location": "https://other.example/x"}), DeviceRefused,
        r"redirects to https://other\.example",
    ),
    "reset": (reset, DeviceLost, "connection cut"),
}  # fmt: skip


@pytest.mark.parametrize("name", FAULTS)
async def test_every_fault_is_one_named_line(camera, client_of, name):
    fault, kind, message = FAULTS[name]
    client = await client_of(camera)
    await client.send(POSITION)
    camera.faults[PTZ] = fault
    with pytest.raises(kind, match=message) as failed:
        await client.send(POSITION)
    assert str(failed.value).startswith(f"{camera.url}{PTZ}?query=position&camera=1: ")
    assert "\n" not in str(failed.value)
    camera.faults.clear()
    await client.send(POSITION)


async def test_no_answer_in_time(camera, client_of):
    client = await client_of(camera)
    camera.faults[PTZ] = hang
    request = requests.Request(path=PTZ, params=POSITION.params, parse=POSITION.parse, timeout_s=0.1)
    with pytest.raises(DeviceLost, match="no answer in time"):
        await client.send(request)


async def test_a_cut_connection_is_tried_three_times(camera, client_of):
    client = await client_of(camera)
    await client.send(POSITION)
    seen = len(camera.seen)
    left = [2]

    async def cut_twice(request):
        if left[0]:
            left[0] -= 1
            await reset(request)

    camera.faults[PTZ] = cut_twice
    await client.send(POSITION)
    assert len(camera.seen) - seen == 3


async def test_nobody_listens(camera, client_of):
    client = await client_of(camera)
    await camera.down()
    with pytest.raises(DeviceLost, match="cannot connect"):
        await client.send(POSITION)


async def test_a_redirect_within_the_camera_is_followed_with_its_cookie(camera, client_of):
    async def queue(request):
        if "ticket" not in request.cookies:
            response = web.Response(status=302, headers={"Location": str(request.rel_url)})
            response.set_cookie("ticket", "1")
            return response
        return None

    camera.faults[PTZ] = queue
    await (await client_of(camera)).send(POSITION)


async def test_not_http_at_all(clock, client_of, camera):
    async def babble(_reader, writer):
        writer.write(b"SSH-2.0-OpenSSH_9.2\r\n")
        writer.close()
        await writer.wait_closed()

    server = await asyncio.start_server(babble, "127.0.0.1", 0)
    camera.url = f"http://127.0.0.1:{server.sockets[0].getsockname()[1]}"
    with pytest.raises((DeviceGarbled, DeviceLost)):
        await (await client_of(camera)).send(POSITION)
    server.close()
    await server.wait_closed()


async def test_tls_to_a_plain_port_says_so(camera, client_of):
    camera.url = camera.url.replace("http:", "https:")
    with pytest.raises(DeviceLost, match=r"ptz\.url is http or https"):
        await (await client_of(camera)).send(POSITION)


@pytest.mark.parametrize(
    ("address", "message"),
    [
        ({"url": "http://root:pass@camera"}, r"ptz\.url: holds a user or a password"),
        ({"url": "camera"}, r"ptz\.url: 'camera' cannot be used"),
        ({"url": "ftp://camera"}, "cannot be used"),
        ({"url": "http://[::1"}, "not a URL"),
        ({"url": "http://my camera/x"}, "cannot be used"),
        ({"url": "http://a..b/x"}, "cannot be used"),
        ({"url": "http://.gate/x"}, "cannot be used"),
        ({"url": "http://gate,lan/x"}, "cannot be used"),
        ({"url": "http://-gate/x"}, "cannot be used"),
        ({"url": "http://%41/x"}, "cannot be used"),
        ({"url": "http://300.1.1.1/x"}, "cannot be used"),
        ({"url": "http://192.0.2.1.5"}, "cannot be used"),
        ({"url": "http://gate:0"}, "cannot be used"),
        ({"url": f"http://{'a' * 64}.lan"}, "cannot be used"),
        ({"url": "https://camera", "certificate_sha256": "12"}, "needs 64 hex digits"),
        ({"url": "https://camera", "certificate_sha256": "zz" * 32}, "needs 64 hex digits"),
    ],
)
def test_addresses_that_cannot_be_used(address, message, clock):
    with pytest.raises(ConfigError, match=message) as refused:
        CameraClient(Address(setting="ptz", **address), clock)
    assert "pass@" not in str(refused.value)


@pytest.mark.parametrize(
    "url",
    ["http://camera", "http://axis_5.lan:8080", "https://[fe80::1]", "http://192.0.2.7/s?a=b", "http://tür.example.",
     "http://a-b.c2/x"],
)  # fmt: skip
def test_addresses_that_can_be(url, clock):
    assert CameraClient(Address(setting="ptz", url=url), clock).origin.startswith("http")


@pytest.mark.parametrize("packing", ["br", "zstd", "deflate", "gzip"])
async def test_a_page_that_is_packed_beyond_reading_is_told_as_that(camera, client_of, packing):
    camera.faults[PTZ] = answer(body=b"\x8b\x02\x80no\x03", headers={"Content-Encoding": packing})
    client = await client_of(camera)
    with pytest.raises(DeviceGarbled, match="compressed in a way") as told:
        await client.send(POSITION)
    assert "Error" not in str(told.value)


async def test_the_password_shows_nowhere(camera, client_of, caplog):
    caplog.set_level(logging.DEBUG)
    camera.challenge = lambda _: [BASIC]
    client = await client_of(camera, allow_basic_over_http=True)
    await client.send(POSITION)
    texts = [repr(client), repr(vars(client))]
    for fault, _, _ in FAULTS.values():
        camera.faults[PTZ] = fault
        with pytest.raises((DeviceLost, DeviceRefused, DeviceGarbled)) as failed:
            await client.send(POSITION)
        texts.append("".join(traceback.TracebackException.from_exception(failed.value, capture_locals=False).format()))
    secrets = (PASSWORD, "cHR6ZDpvcmFuZ2UtQmljeWNsZV83Nw")
    assert not [text for text in [*texts, caplog.text] if any(secret in text for secret in secrets)]
