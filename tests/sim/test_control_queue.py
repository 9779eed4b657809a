import aiohttp
import pytest

from ptzd.sim.auth import Role
from ptzd.sim.control_queue import TIMEOUT_S, ControlQueue


def test_the_first_is_in_control_and_the_next_waits():
    queue = ControlQueue()
    assert queue.request("a", Role.OPERATOR, 0.0)
    assert queue.request("b", Role.OPERATOR, 10.0)
    assert queue.control("a", 10.0)
    assert not queue.control("b", 10.0)
    assert queue.query("a", 10.0) == (1, 0)
    assert queue.query("b", 20.0) == (2, 50)
    assert queue.query("c", 20.0) == (0, 0)


def test_an_administrator_takes_over_and_an_operator_overtakes_viewers():
    queue = ControlQueue()
    for name, role in (("viewer", Role.VIEWER), ("operator", Role.OPERATOR), ("admin", Role.ADMINISTRATOR)):
        queue.request(name, role, 0.0)
        assert queue.control(name, 0.0)
    assert [queue.query(name, 0.0)[0] for name in ("admin", "operator", "viewer")] == [1, 2, 3]


def test_idle_control_ends_and_activity_keeps_it():
    queue = ControlQueue()
    queue.request("a", Role.OPERATOR, 0.0)
    queue.request("b", Role.OPERATOR, 0.0)
    assert queue.control("a", TIMEOUT_S - 1)
    assert queue.control("a", 2 * TIMEOUT_S - 2)
    assert not queue.control("a", 3 * TIMEOUT_S)
    assert queue.control("b", 3 * TIMEOUT_S)


def test_a_viewers_time_ends_although_it_is_active():
    queue = ControlQueue()
    queue.request("v", Role.VIEWER, 0.0)
    assert queue.control("v", TIMEOUT_S - 1)
    assert not queue.control("v", TIMEOUT_S)


def test_giving_up_lets_the_next_in_with_its_full_time_and_a_full_queue_refuses():
    queue = ControlQueue(limit=2)
    queue.request("a", Role.OPERATOR, 0.0)
    queue.request("b", Role.OPERATOR, 0.0)
    assert not queue.request("c", Role.OPERATOR, 1.0)
    queue.drop("a", 50.0)
    assert queue.control("b", 50.0 + TIMEOUT_S - 1)


@pytest.fixture
async def queued(start):
    visitor = await start()
    visitor.rig.camera.unit.parameters["PTZ.Various.V1.CtlQueueing"] = "true"
    return visitor


async def test_over_http_a_client_gets_a_cookie_by_a_redirect_and_then_the_control(queued):
    assert (await queued.ptz(pan=5)).status == 204
    assert [cookie.key for cookie in queued.session.cookie_jar] == ["ptz_ctl_id"]
    place = await queued.get("/axis-cgi/com/ptzqueue.cgi", control="query")
    assert place.text == '<a name="1"></a><a name="0"></a><a name="20"></a>'
    login = aiohttp.DigestAuthMiddleware("ptzd", "pan-tilt-zoom")
    jar = aiohttp.CookieJar(unsafe=True)
    async with aiohttp.ClientSession(middlewares=(login,), cookie_jar=jar) as second:
        url = queued.rig.camera_url + "/axis-cgi/com/"
        async with second.get(url + "ptz.cgi?pan=9") as reply:
            assert (reply.status, (await reply.text())[:6]) == (200, "Error:")
        async with second.get(url + "ptz.cgi?query=speed") as reply:
            assert await reply.text() == "speed=100\r\n"
        async with second.get(url + "ptzqueue.cgi?control=query") as reply:
            assert (await reply.text()).startswith('<a name="2"></a>')
        assert (await queued.get("/axis-cgi/com/ptzqueue.cgi", control="drop")).text.startswith('<a name="0"></a>')
        async with second.get(url + "ptz.cgi?pan=9") as reply:
            assert reply.status == 204


async def test_without_the_queue_its_cgi_says_so(start):
    visitor = await start()
    assert (await visitor.get("/axis-cgi/com/ptzqueue.cgi", control="query")).text.startswith("Error:")
