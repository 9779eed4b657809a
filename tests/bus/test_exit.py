from __future__ import annotations

import asyncio
import subprocess
import sys

import zenoh
from zenoh.handlers import Callback

from ptzd.bus.session import close_session, daemon_config, open_session
from ptzd.config import BusSettings

PROGRAM = """
import asyncio, sys, time
from ptzd.bus.client import Client
from ptzd.bus.server import ZenohBus
from ptzd.config import BusSettings

class Clock:
    def now_ns(self): return time.monotonic_ns()
    def from_monotonic_ns(self, t): return t

async def forgetful(endpoint):
    bus = await ZenohBus(BusSettings(listen=(endpoint,)), "hall", Clock()).__aenter__()
    client = await Client.open(endpoint, rig="hall", timeout_s=100.0).__aenter__()
    print((await client.status()).state, flush=True)

async def steady(endpoint):
    settings = BusSettings(mode="client", listen=(), connect=(endpoint,))
    async with ZenohBus(settings, "hall", Clock()):
        print("up", flush=True)
        await asyncio.Event().wait()

asyncio.run(globals()[sys.argv[1]](sys.argv[2]))
"""


def test_an_exit_without_closing_does_not_hang(endpoint):
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM, "forgetful", endpoint], capture_output=True, text=True, timeout=100, check=False
    )
    assert done.stdout == "STARTING\n"
    assert done.returncode == 0, done.stderr


async def test_a_killed_daemon_is_soon_known_to_be_gone(endpoint):
    session = await open_session(daemon_config(BusSettings(listen=(endpoint,))), "hub")
    loop, come, gone = asyncio.get_running_loop(), asyncio.Event(), asyncio.Event()

    def receive(sample: zenoh.Sample) -> None:
        news = gone if sample.kind == zenoh.SampleKind.DELETE else come
        loop.call_soon_threadsafe(news.set)

    watcher = session.liveliness().declare_subscriber("ptzd/*/alive", Callback(receive, indirect=False), history=True)
    daemon = await asyncio.create_subprocess_exec(
        sys.executable, "-c", PROGRAM, "steady", endpoint, stdout=asyncio.subprocess.PIPE
    )
    assert await daemon.stdout.readline() == b"up\n"
    async with asyncio.timeout(100):
        await come.wait()
        daemon.kill()
        await gone.wait()
    assert await daemon.wait() == -9
    watcher.undeclare()
    await close_session(session)
