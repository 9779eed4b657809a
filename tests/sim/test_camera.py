"""The camera as a stranger meets it: over a socket."""

import asyncio
import itertools
import ssl

import aiohttp
import pytest

from ptzd.errors import SimulationError
from ptzd.sim.auth import Policy, Role, User
from ptzd.sim.clock import VirtualClock
from ptzd.sim.faults import Fault, FaultKind
from ptzd.sim.rig import SimRig
from ptzd.sim.settings import SimSettings

PTZ = "/axis-cgi/com/ptz.cgi"
PARAM = "/axis-cgi/param.cgi"


async def raw(visitor, path: str, **headers: str) -> aiohttp.ClientResponse:
    """A request without any credentials of its own."""
    async with aiohttp.ClientSession() as session, session.get(visitor.rig.camera_url + path, headers=headers) as reply:
        await reply.read()
        return reply


async def test_a_command_is_204_empty_and_a_query_is_plain_text(visitor):
    moved = await visitor.ptz(pan=5)
    assert (moved.status, moved.body) == (204, b"")
    asked = await visitor.ptz(query="position")
    assert asked.status == 200
    assert asked.headers["Content-Type"] == "text/plain"
    assert asked.text.startswith("pan=")


async def test_an_error_is_a_200_that_says_error(visitor):
    answer = await visitor.ptz(pan="x")
    assert (answer.status, answer.text) == (200, "Error:\r\npan: invalid value\r\n")


async def test_a_form_works_like_a_query(visitor):
    async with visitor.session.post(visitor.rig.camera_url + PTZ, data={"pan": "12", "camera": "1"}) as reply:
        assert reply.status == 204
    await visitor.rest()
    assert (await visitor.position())["pan"] == 12


async def test_nothing_in_the_headers_tells_that_it_is_a_simulation(visitor):
    for path in (f"{PTZ}?query=limits", "/axis-cgi/nothing.cgi", "/axis-cgi/jpg/image.cgi?resolution=320x240"):
        answer = await visitor.get(path)
        text = f"{answer.headers} {answer.text[:300]}".lower()
        assert "aiohttp" not in text
        assert "python" not in text


async def test_the_position_lags_while_it_moves_and_is_exact_at_rest(start, clock):
    visitor = await start(clock=clock)
    head = visitor.rig.camera.unit.head
    await visitor.ptz(pan=60, tilt=20, zoom=2000)
    seen = []
    while head.busy(clock.now_s()):
        seen.append((head.encoder(clock.now_s()).pan_deg, (await visitor.position())["pan"]))
        clock.advance(0.1)
    assert any(encoder - reported > 1 for encoder, reported in seen)
    clock.advance(1.0)
    assert await visitor.position() == {"pan": 60, "tilt": 20, "zoom": 2000}


async def test_without_credentials_there_is_a_challenge_and_a_page(visitor):
    reply = await raw(visitor, f"{PTZ}?query=position")
    assert reply.status == 401
    assert reply.headers.getall("WWW-Authenticate")[0].startswith('Digest realm="AXIS_ACCC8E5915A1"')
    assert reply.headers["Content-Type"] == "text/html"


async def test_one_challenge_serves_many_requests_and_a_stale_nonce_is_renewed(start, clock):
    visitor = await start(nonce_life_s=0.2, clock=clock)
    for _ in range(5):
        assert (await visitor.ptz(query="speed")).status == 200
        clock.advance(0.1)


async def test_a_wrong_password_takes_its_time(start):
    visitor = await start(wrong_password_s=0.1, policy=Policy.BASIC)
    before = visitor.rig.clock.now_s()
    reply = await raw(visitor, f"{PTZ}?query=position", Authorization=aiohttp.encode_basic_auth("ptzd", "no"))
    assert reply.status == 401
    assert visitor.rig.clock.now_s() - before >= 0.1


async def test_twenty_failures_a_second_are_blocked(start, clock):
    visitor = await start(wrong_password_s=0.0, policy=Policy.BASIC, clock=clock)
    url, wrong = visitor.rig.camera_url + PTZ, {"Authorization": aiohttp.encode_basic_auth("ptzd", "no")}
    async with aiohttp.ClientSession() as session:
        replies = await asyncio.gather(*(session.get(url, headers=wrong) for _ in range(25)))
        for reply in replies:
            reply.release()
    assert [reply.status for reply in replies].count(401) <= 22
    assert (await raw(visitor, PTZ, Authorization=aiohttp.encode_basic_auth("ptzd", "pan-tilt-zoom"))).status == 403


async def test_roles(start):
    viewer = await start(role=Role.VIEWER, ptz_right=False)
    assert (await viewer.ptz(query="position")).status == 403
    assert (await viewer.get("/axis-cgi/com/ptzconfig.cgi", setserverpresetname="a")).status == 403
    listed = await viewer.get(PARAM, action="list", group="System")
    assert listed.text.startswith("# Error:")
    assert (await viewer.get("/axis-cgi/jpg/image.cgi", resolution="160x120")).status == 200
    operator = await start(role=Role.OPERATOR)
    assert (await operator.ptz(pan=1)).status == 204
    assert (await operator.get(PARAM, action="update", **{"PTZ.Various.V1.ReturnToOverview": 9})).status == 403
    groups = await operator.get("/axis-cgi/usergroup.cgi")
    assert groups.text == "ptzd\r\noperator viewer ptz\r\n"


async def test_two_users_have_their_own_passwords(start):
    visitor = await start(extra_users=(User(name="root", password="r", role=Role.ADMINISTRATOR),))
    login = aiohttp.DigestAuthMiddleware("root", "r")
    url = visitor.rig.camera_url + PARAM
    async with aiohttp.ClientSession(middlewares=(login,)) as root:
        async with root.get(url, params={"action": "update", "root.PTZ.Various.V1.Locked": "true"}) as reply:
            assert await reply.text() == "OK"
        async with root.get(url, params={"action": "update", "PTZ.Nonsense": "1"}) as reply:
            assert await reply.text() == "# Error: Error setting 'root.PTZ.Nonsense' to '1'!\n"
    assert (await visitor.ptz(pan=9)).status == 204
    assert not visitor.rig.camera.unit.orders


async def test_parameters_come_by_group_with_and_without_root_and_with_wildcards(visitor):
    for group in ("PTZ.Limit", "root.PTZ.Limit.L1", "PTZ.Limit.*"):
        values = (await visitor.get(PARAM, action="list", group=group)).values
        assert values["root.PTZ.Limit.L1.MaxPan"] == "170"
        assert all(name.startswith("root.PTZ.Limit.") for name in values)
    both = (await visitor.get(PARAM, action="list", group="Brand,Properties.PTZ")).values
    assert both["root.Brand.Brand"] == "AXIS"
    assert both["root.Properties.PTZ.PTZ"] == "yes"
    everything = (await visitor.get(PARAM, action="list")).values
    assert len(everything) > 150
    unknown = await visitor.get(PARAM, action="list", group="Nope")
    assert (unknown.status, unknown.text) == (200, "# Error: Error -1 getting param in group 'Nope'\n")


async def test_device_information(visitor):
    url = visitor.rig.camera_url + "/axis-cgi/basicdeviceinfo.cgi"
    ask = {"apiVersion": "1.0", "context": "c", "method": "getAllProperties"}
    async with visitor.session.post(url, json=ask) as reply:
        document = await reply.json()
    assert document["context"] == "c"
    assert document["data"]["propertyList"]["ProdNbr"] == "V5915"
    async with aiohttp.ClientSession() as nobody:
        url = visitor.rig.camera_url + "/axis-cgi/systemready.cgi"
        async with nobody.post(url, json={"apiVersion": "1.1", "method": "systemready"}) as reply:
            assert (await reply.json())["data"]["systemready"] == "yes"


async def test_https_has_a_certificate_of_its_own_and_wants_basic(start):
    visitor = await start(https=True)
    pin = aiohttp.Fingerprint(bytes.fromhex(visitor.rig.camera.certificate.sha256))
    url = f"{visitor.rig.camera.https_url}{PTZ}?query=position"
    async with aiohttp.ClientSession() as session:
        async with session.get(url, ssl=pin) as reply:
            assert reply.status == 401
            assert reply.headers.getall("WWW-Authenticate") == ['Basic realm="AXIS_ACCC8E5915A1"']
        login = {"Authorization": aiohttp.encode_basic_auth("ptzd", "pan-tilt-zoom")}
        async with session.get(url, ssl=pin, headers=login) as reply:
            assert (await reply.text()).startswith("pan=")
    trusted = ssl.create_default_context(cadata=visitor.rig.camera.certificate.pem)
    async with aiohttp.ClientSession() as session, session.get(url, ssl=trusted, headers=login) as reply:
        assert reply.status == 200


async def test_a_reboot_refuses_then_says_503_then_is_ready_at_home_on_the_same_port(start, clock):
    visitor = await start(boot_s=30.0, clock=clock)
    head = visitor.rig.camera.unit.head
    await visitor.ptz(pan=20)
    clock.advance(30.0)
    assert (await visitor.position())["pan"] == 20

    async def until_it_says(kind: str) -> None:
        said = ""
        while said != kind:
            clock.advance(0.01)
            try:
                said = str((await visitor.ptz(query="speed")).status)
            except aiohttp.ClientConnectionError:
                said = "refused"
            seen.append(said)

    seen: list[str] = []
    visitor.rig.camera.reboot()
    await until_it_says("refused")
    clock.advance(30.0)
    await until_it_says("503")
    clock.advance(15.0)
    await until_it_says("200")
    kinds = [kind for kind, _ in itertools.groupby(seen)]
    assert kinds in (["refused", "503", "200"], ["503", "refused", "503", "200"])
    clock.advance(30.0)
    assert not head.busy(clock.now_s())
    assert (await visitor.position())["pan"] == 0


@pytest.mark.parametrize(("fault", "status", "text"), [
    (Fault(kind=FaultKind.STATUS, status=503), 503, "503"),
    (Fault(kind=FaultKind.STATUS, status=401), 401, "401"),
    (Fault(kind=FaultKind.HTML), 200, "<html>"),
    (Fault(kind=FaultKind.ERROR_TEXT), 200, "Error:\r\n"),
    (Fault(kind=FaultKind.EMPTY), 200, ""),
    (Fault(kind=FaultKind.GARBAGE), 200, "pan=n/a#"),
    (Fault(kind=FaultKind.SLOW, delay_s=0.1), 200, "pan=0.0000"),
])  # fmt: skip
async def test_faults_of_answers(visitor, fault, status, text):
    with visitor.rig.camera.faults.during(fault, visitor.rig.clock.now_s()):
        answer = await visitor.ptz(query="position")
    assert answer.status == status
    assert text in answer.text
    assert (await visitor.ptz(query="position")).values["zoom"] == "1"


async def test_a_reset_cuts_the_connection_and_a_hang_never_answers(visitor):
    with (
        visitor.rig.camera.faults.during(Fault(kind=FaultKind.RESET, path="*query=speed*"), 0),
        pytest.raises(aiohttp.ClientConnectionError),
    ):
        await visitor.ptz(query="speed")
    with visitor.rig.camera.faults.during(Fault(kind=FaultKind.HANG), 0), pytest.raises(TimeoutError):
        await asyncio.wait_for(visitor.ptz(query="speed"), 0.2)
    assert (await visitor.ptz(query="speed")).status == 200


async def test_another_user_and_the_overview_move_the_head(start):
    visitor = await start()
    visitor.rig.inject(Fault(kind=FaultKind.FOREIGN_MOVE, pan=25.0, zoom=300.0))
    await visitor.until(lambda: bool(visitor.rig.camera.unit.orders))
    await visitor.rest()
    assert (await visitor.position())["pan"] == 25
    visitor.rig.camera.unit.parameters["PTZ.Various.V1.ReturnToOverview"] = "1"
    await visitor.until(lambda: visitor.rig.camera.unit.at_home() and len(visitor.rig.camera.unit.orders) == 2)
    await visitor.rest()
    assert (await visitor.position())["pan"] == 0
    orders = (await visitor.truth("/truth/orders"))["orders"]
    assert [order["source"] for order in orders] == ["another user", "return to overview"]


async def test_a_recalibration_drives_into_the_stops_and_comes_back(start):
    visitor = await start(rate=15.0, profile="old214", home=(150.0, 80.0, 1.0))
    visitor.rig.inject(Fault(kind=FaultKind.RECALIBRATE))
    await visitor.until(lambda: len(visitor.rig.camera.unit.orders) == 3)
    await visitor.rest()
    assert (await visitor.position())["pan"] == pytest.approx(150, abs=0.02)
    assert visitor.rig.camera.unit.orders[0].source == "recalibration"


async def test_a_port_in_use_is_named(visitor, room):
    settings = SimSettings(ptz_port=visitor.rig.camera.port)
    with pytest.raises(SimulationError, match=f"127.0.0.1:{visitor.rig.camera.port}"):
        async with SimRig(settings, scene=room):
            pass


async def test_hundred_keep_alive_requests_one_connection(visitor):
    connector = aiohttp.TCPConnector(limit=1)
    login = aiohttp.DigestAuthMiddleware("ptzd", "pan-tilt-zoom")
    async with aiohttp.ClientSession(middlewares=(login,), connector=connector) as session:
        for _ in range(100):
            async with session.get(visitor.rig.camera_url + PTZ, params={"query": "speed"}) as reply:
                assert reply.status == 200
                assert reply.headers.get("Connection", "keep-alive") == "keep-alive"


async def test_a_guard_tour_walks_the_presets_until_it_is_stopped(start):
    visitor = await start(rate=20.0)
    unit = visitor.rig.camera.unit
    await visitor.ptz(pan=30)
    await visitor.rest()
    await visitor.ptz(setserverpresetname="Gate")
    visitor.rig.inject(Fault(kind=FaultKind.PARAMETER, name="GuardTour.G0.Running", value="yes"))
    await visitor.until(lambda: [order.source for order in unit.orders].count("guard tour") >= 3)
    unit.parameters["GuardTour.G0.Running"] = "no"
    targets = [order.order.pan for order in unit.orders if order.source == "guard tour"]
    assert targets[:3] == [0, 30, 0]


async def test_auto_flip_goes_on_beyond_the_stop(start):
    visitor = await start(profile="inverted", rate=20.0)
    visitor.rig.camera.unit.parameters["PTZ.UserAdv.U1.AutoFlip"] = "true"
    await visitor.ptz(pan=175)
    await visitor.rest()
    await visitor.ptz(rpan=20)
    await visitor.rest()
    assert (await visitor.position())["pan"] == pytest.approx(-165, abs=0.01)


async def test_digital_zoom_goes_on_where_it_is_wanted_only(start):
    visitor, plain = await start(digital_zoom=True, rate=10.0), await start()
    assert (await visitor.ptz(query="limits")).values["MaxZoom"] == "19999"
    await visitor.ptz(zoom=19999)
    await visitor.rest()
    assert (await visitor.position())["zoom"] == 19999
    fields = [float((await side.truth("/truth/pose"))["hfov_deg"]) for side in (visitor, plain)]
    assert fields[0] < 1.2
    assert (await plain.ptz(zoom=10000)).text == "Error:\r\nzoom: invalid value\r\n"


async def test_on_a_virtual_clock_time_passes_by_hand(room):
    clock = VirtualClock()
    login = aiohttp.DigestAuthMiddleware("ptzd", "pan-tilt-zoom")
    async with (
        SimRig(SimSettings(), scene=room, clock=clock) as rig,
        aiohttp.ClientSession(middlewares=(login,)) as session,
    ):
        url = rig.camera_url + PTZ
        async with session.get(url, params={"pan": "100", "speed": "40"}) as reply:
            assert reply.status == 204
        for _ in range(2):
            async with session.get(url, params={"query": "position"}) as reply:
                assert (await reply.text()).startswith("pan=0.0000")
        clock.advance(15.0)
        async with session.get(url, params={"query": "position"}) as reply:
            assert (await reply.text()).startswith("pan=100.0000")
