"""Whatever a camera answers, its reader ends in a loss that names it, and the camera is back when it is right again."""

from __future__ import annotations

import asyncio
import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ptzd.config import HttpSource
from ptzd.devices.http_fisheye import HttpFisheye
from ptzd.devices.vapix.auth import parse_challenges
from ptzd.devices.vapix.feed import Feed, supervise
from ptzd.errors import DeviceError, DeviceGarbled
from tests.devices.vapix.conftest import Clock, picture

STREAM = b"HTTP/1.1 200 OK\r\nContent-Type: multipart/x-mixed-replace; boundary=b\r\n\r\n"
GOOD = STREAM + b"".join(b"--b\r\nContent-Type: image/jpeg\r\n\r\n" + picture(n) + b"\r\n" for n in range(40))
ODD = [
    b"HTTP/1.1 307 T\r\nLocation: http://camera:port/\r\nContent-Length: 0\r\n\r\n",
    b"HTTP/1.1 302 F\r\nLocation: //\xe9t\xe9/\r\nContent-Length: 0\r\n\r\n",
    b"HTTP/1.1 301 M\r\nLocation: mailto:somebody\r\nContent-Length: 0\r\n\r\n",
    b'HTTP/1.1 401 U\r\nWWW-Authenticate: Digest realm="caf\xe9", nonce="n"\r\nContent-Length: 0\r\n\r\n',
    b'HTTP/1.1 401 U\r\nWWW-Authenticate: Digest realm="r", nonce="\xe9", qop="auth"\r\nContent-Length: 0\r\n\r\n',
    b"HTTP/1.1 401 U\r\nWWW-Authenticate: Basic\r\nContent-Length: 0\r\n\r\n",
    STREAM[:-2] + b"Content-Encoding: gzip\r\n\r\nno gzip",
    STREAM + b"--b\r\n\r\n<html>" * 200,
    b"HTTP/1.1 200 OK\r\nContent-Type: text/html\r\nContent-Length: 2\r\n\r\nhi",
    b"nonsense\r\n\r\n",
]


@pytest.fixture
async def speaking():
    """A server that says something, then something else, once for each connection; the last again and again."""
    servers = []

    async def start(*said: bytes) -> int:
        left = list(said)

        async def answer(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
            try:
                await reader.readuntil(b"\r\n\r\n")
                writer.write(left.pop(0) if len(left) > 1 else left[0])
                await writer.drain()
            except (ConnectionError, asyncio.IncompleteReadError):
                pass
            writer.close()

        server = await asyncio.start_server(answer, "127.0.0.1", 0)
        servers.append(server)
        return server.sockets[0].getsockname()[1]

    yield start
    for server in servers:
        server.close()
        await server.wait_closed()


def fisheye(port: int, password_file) -> HttpFisheye:
    source = HttpSource(url=f"http://127.0.0.1:{port}/s", user="u", password_file=str(password_file), stall_s=30.0)
    return HttpFisheye(source, Clock(), jitter=lambda: 0.0)


CLASS = re.compile(r"[A-Za-z]+(?:Error|Exception|Encoding\.)|Disconnected|[a-z]+\.[A-Z]\w+")
"""Names of Python's and its libraries' classes."""


@pytest.mark.parametrize("odd", ODD)
async def test_an_odd_answer_is_a_loss_with_the_cameras_name(speaking, password_file, odd):
    port = await speaking(odd)
    async with fisheye(port, password_file) as source:
        async with asyncio.timeout(20):
            with pytest.raises(DeviceError, match=f"127.0.0.1:{port}/s: ") as told:
                await anext(source.pictures())
    assert not CLASS.search(str(told.value)), "an operator reads words"


@pytest.mark.parametrize("odd", [ODD[0], ODD[2], ODD[6], ODD[9]])
async def test_a_camera_that_is_right_again_is_back(speaking, password_file, odd):
    port = await speaking(odd, GOOD)
    async with fisheye(port, password_file) as source, asyncio.timeout(30):
        with pytest.raises(DeviceError):
            await anext(source.pictures())
        pictures = source.pictures()
        assert (await anext(pictures)).jpeg in [picture(n) for n in range(40)]
        await pictures.aclose()


async def test_a_stream_that_moved_is_found_under_the_address_that_is_advised(speaking, password_file):
    there = await speaking(GOOD)
    moved = f"HTTP/1.1 301 M\r\nLocation: http://127.0.0.1:{there}/live/s\r\nContent-Length: 0\r\n\r\n"
    async with fisheye(await speaking(moved.encode()), password_file) as source, asyncio.timeout(20):
        with pytest.raises(DeviceError) as told:
            await anext(source.pictures())
    found = re.search(r"redirects to (\S+); if that is right, set it as fisheye\.url", str(told.value))
    assert found is not None
    assert found[1] == f"http://127.0.0.1:{there}/live/s"
    settings = HttpSource(url=found[1], user="u", password_file=str(password_file), stall_s=30.0)
    async with HttpFisheye(settings, Clock(), jitter=lambda: 0.0) as source, asyncio.timeout(20):
        pictures = source.pictures()
        assert (await anext(pictures)).jpeg in [picture(n) for n in range(40)]
        await pictures.aclose()


@pytest.mark.parametrize(
    ("location", "told"),
    [
        ("http://127.0.0.1:1/new?u=me&word=hush", "redirects to http://127.0.0.1:1/new with another query"),
        (
            "http://127.0.0.1:1/new?word=hush&a=b",
            "redirects to http://127.0.0.1:1/new with the query that fisheye.url has",
        ),
        ("http://me:hush@127.0.0.1:1/new", "redirects to http://127.0.0.1:1/new; if"),
        ("http://me:hush@127.0.0.1:80new", "redirects to 'http://127.0.0.1:80new', which is no address"),
        ("http://me:hush@127.0.0.1:80new//deep", "redirects to 'http://127.0.0.1:80new//deep', which is no address"),
        ("ftp://127.0.0.1/new", "redirects to 'ftp://127.0.0.1/new', which is no address"),
        ("http://my camera/new", "redirects to 'http://my camera/new', which is no address"),
        ("http://gate..lan/new", "redirects to 'http://gate..lan/new', which is no address"),
        ("http://192.0.2.1.5/new", "redirects to 'http://192.0.2.1.5/new', which is no address"),
        ("", "redirects (302) and does not say where to"),
        ("   ", "redirects (302) and does not say where to"),
        ("http://127.0.0.1:80new?word=hush", "redirects to 'http://127.0.0.1:80new', which is no address"),
    ],
)
async def test_a_redirect_is_told_without_its_secrets(speaking, password_file, location, told):
    port = await speaking(f"HTTP/1.1 302 F\r\nLocation: {location}\r\nContent-Length: 0\r\n\r\n".encode())
    settings = HttpSource(url=f"http://127.0.0.1:{port}/s?word=hush&a=b", stall_s=30.0)
    async with HttpFisheye(settings, Clock(), jitter=lambda: 0.0) as source, asyncio.timeout(20):
        with pytest.raises(DeviceError, match=re.escape(told)) as error:
            await anext(source.pictures())
    assert "hush" not in str(error.value)


async def test_a_redirect_without_a_place_is_told_as_that(speaking, password_file):
    port = await speaking(b"HTTP/1.1 307 T\r\nContent-Length: 0\r\n\r\n")
    async with fisheye(port, password_file) as source, asyncio.timeout(20):
        with pytest.raises(DeviceGarbled, match=r"redirects \(307\) and does not say where to"):
            await anext(source.pictures())


@pytest.mark.parametrize("packing", ["br", "zstd", "deflate", "gzip", "BR"])
async def test_a_packing_is_told_as_one_whoever_finds_it(speaking, password_file, packing):
    head = (
        f"HTTP/1.1 200 OK\r\nContent-Type: multipart/x-mixed-replace; boundary=b\r\nContent-Encoding: {packing}\r\n\r\n"
    )
    port = await speaking(head.encode() + b"\x8b\x02\x80abc\x03" * 20)
    async with fisheye(port, password_file) as source, asyncio.timeout(20):
        with pytest.raises(DeviceGarbled, match=r"(?s)switch compression.* off") as told:
            await anext(source.pictures())
    assert not CLASS.search(str(told.value))


async def test_a_packed_stream_is_refused_with_one_address(speaking, password_file):
    port = await speaking(ODD[6])
    async with fisheye(port, password_file) as source, asyncio.timeout(20):
        with pytest.raises(DeviceGarbled, match="Content-Encoding") as told:
            await anext(source.pictures())
    assert str(told.value).count("127.0.0.1") == 1


@given(st.lists(st.text(max_size=60), max_size=3))
def test_challenges_of_any_text_are_understood_or_named(values):
    parse_challenges(values)


async def test_a_defect_in_a_reader_is_a_loss_and_is_told_to_the_loop():
    told = []
    asyncio.get_running_loop().set_exception_handler(lambda loop, context: told.append(context["message"]))
    feed: Feed[int] = Feed(1)
    feed.open()

    async def broken() -> None:
        raise KeyError("pan")

    task = asyncio.create_task(broken())
    task.add_done_callback(lambda done: supervise(done, feed=feed, name="the stream"))
    with pytest.raises(DeviceGarbled, match="internal error in the stream: KeyError: 'pan'"):
        await feed.after(0)
    assert told == ["internal error in the stream: KeyError: 'pan'"]
