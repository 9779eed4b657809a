"""Apps that listen to pictures and then read no more: a closed lid, a debugger."""

from __future__ import annotations

import asyncio
import signal
import sys

LISTENER = """
import json, sys, time
import zenoh

config = zenoh.Config()
settings = {"mode": "client", "connect/endpoints": [sys.argv[1]], "listen/endpoints": [],
            "scouting/multicast/enabled": False, "transport/link/tx/lease": 1000}
for key, value in settings.items():
    config.insert_json5(key, json.dumps(value))
session = zenoh.open(config)
subscriber = session.declare_subscriber("ptzd/demo/image/*", lambda sample: print("picture", flush=True))
time.sleep(600)
"""
"""One that is given up a second after its last sign of life."""
LISTENERS = 6
LINGER_S = 10.0
"""For so long the kernel holds whoever closes a connection whose other end reads no more."""


async def test_they_cost_nobody_else_the_bus(make_site) -> None:
    site = await make_site()
    daemon = await site.spawn()
    listeners = [
        await asyncio.create_subprocess_exec(
            sys.executable, "-c", LISTENER, site.endpoint, stdout=asyncio.subprocess.PIPE
        )
        for _ in range(LISTENERS)
    ]
    try:
        for listener in listeners:
            assert (await listener.stdout.readline()).strip() == b"picture"
            listener.send_signal(signal.SIGSTOP)
        loop = asyncio.get_running_loop()
        started_s, slowest_s = loop.time(), 0.0
        # the leases run out in this time, and the closing of the connections begins
        while loop.time() - started_s < LINGER_S:
            asked_s = loop.time()
            await site.client.status()
            slowest_s = max(slowest_s, loop.time() - asked_s)
            await asyncio.sleep(0.05)
        assert slowest_s < LINGER_S / 4
        await site.lock("meanwhile")
        assert daemon.returncode is None
    finally:
        for listener in listeners:
            listener.kill()
            await listener.wait()
