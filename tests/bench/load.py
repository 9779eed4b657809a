"""How fast a stop is while others load the bus: ``python -m tests.bench.load`` (or ``make bench-load``).

Twenty stops for each kind of load. "At the camera" is from the stop's sending to the simulator taking the order, by the
simulator's own time; "confirmed" is until the operator has the answer, which waits for proven rest.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from statistics import median

import zenoh

from tests.bench.site import RIG, LiveRig

STOPS = 20
CLIENTS = 5
PER_CLIENT_HZ = 200.0
LOOKERS = 20
PREFIX = f"ptzd/{RIG}"


def open_session(endpoint: str) -> zenoh.Session:
    config = zenoh.Config()
    config.insert_json5("mode", '"client"')
    config.insert_json5("connect/endpoints", json.dumps([endpoint]))
    config.insert_json5("scouting/multicast/enabled", "false")
    deadline = time.monotonic() + 60
    while True:
        try:
            return zenoh.open(config)
        except zenoh.ZError:
            if time.monotonic() > deadline:
                raise
        time.sleep(0.2)


def body(name: str, **more: object) -> bytes:
    box = {"x": 310, "y": 220, "w": 40, "h": 32}
    return json.dumps({"id": name, "box": box, "timeout_s": 20, **more}).encode()


def flood(endpoint: str, name: str) -> None:
    """Requests by query and by put, until ended."""
    with open_session(endpoint) as session:
        started, sent = time.monotonic(), 0
        while time.monotonic() - started < 600:
            while sent < (time.monotonic() - started) * PER_CLIENT_HZ:
                payload = body(f"{name}-{sent}", hold_s=0.5, priority=sent % 3)
                if sent % 2:
                    session.put(f"{PREFIX}/roi", payload)
                else:
                    session.get(f"{PREFIX}/roi", lambda reply: None, payload=payload, timeout=5.0)
                sent += 1
            time.sleep(0.005)


def look(endpoint: str) -> None:
    """Questions for all results, several at once, again and again."""
    with open_session(endpoint) as session:
        started = time.monotonic()
        while time.monotonic() - started < 600:
            asked = [session.get(f"{PREFIX}/roi/*/result", timeout=30.0) for _ in range(LOOKERS)]
            for handler in asked:
                for _ in handler:
                    pass


def listen_and_stall(endpoint: str) -> None:
    """Listen to pictures, then stop reading: a closed laptop, a debugger."""
    with open_session(endpoint) as session:
        seen = threading.Event()
        session.declare_subscriber(f"{PREFIX}/image/*", lambda sample: seen.set())
        seen.wait(20)
        os.kill(os.getpid(), signal.SIGSTOP)


@contextmanager
def loaded(endpoint: str, kind: str, count: int) -> Iterator[None]:
    """Some processes of this module beside, ended by their ids."""
    command = [sys.executable, "-m", "tests.bench.load", kind, endpoint]
    processes = [subprocess.Popen([*command, f"c{number}-{time.time_ns()}"]) for number in range(count)]
    time.sleep(3.0 if processes else 0.0)
    try:
        yield
    finally:
        for process in processes:
            process.send_signal(signal.SIGKILL)
            process.wait()


def one_stop(rig: LiveRig, session: zenoh.Session, number: int) -> tuple[float, float]:
    """Seconds until the camera has the stop, and until it is confirmed."""
    for _ in session.get(f"{PREFIX}/roi", payload=body(f"mine-{time.time_ns()}", hold_s=20, priority=9), timeout=5.0):
        pass
    time.sleep(0.3 + 0.07 * (number % 5))
    sent_ns = time.monotonic_ns()
    answers = list(session.get(f"{PREFIX}/control/stop", timeout=20.0))
    answered_ns = time.monotonic_ns()
    if not answers:
        raise SystemExit("a stop got no answer")
    seen_ns = rig.stop_seen_ns(sent_ns)
    if seen_ns is None:
        raise SystemExit("the camera saw no stop")
    return (seen_ns - sent_ns) / 1e9, (answered_ns - sent_ns) / 1e9


def measure(rig: LiveRig, stops: int) -> list[tuple[float, float]]:
    with open_session(rig.endpoint) as session:
        return [one_stop(rig, session, number) for number in range(stops)]


def wait_until_serving(rig: LiveRig) -> None:
    with open_session(rig.endpoint) as session:
        deadline = time.monotonic() + 60
        while time.monotonic() < deadline:
            for reply in session.get(f"{PREFIX}/status", timeout=2.0):
                if reply.ok is not None and json.loads(reply.ok.payload.to_bytes())["state"] == "IDLE":
                    return
            time.sleep(0.2)
    raise SystemExit("the rig does not become idle")


KINDS: dict[str, Callable[[str, str], None]] = {
    "flood": flood,
    "look": lambda endpoint, name: look(endpoint),
    "stall": lambda endpoint, name: listen_and_stall(endpoint),
}
LOADS = (
    ("nothing else", "", 0),
    ("five clients, 1,000 requests a second", "flood", CLIENTS),
    ("20 wildcard questions for results at once, for ever", "look", 1),
    ("a stopped image listener", "stall", 1),
    ("three stopped image listeners", "stall", 3),
)


def main(stops: int = STOPS) -> None:
    print("| load | stop at the camera, median / largest | confirmed, median / largest |")
    print("|---|---|---|")
    with tempfile.TemporaryDirectory() as folder, LiveRig(Path(folder)) as rig:
        wait_until_serving(rig)
        for text, kind, count in LOADS:
            with loaded(rig.endpoint, kind, count):
                found = measure(rig, stops)
            seen, confirmed = zip(*found, strict=True)
            cells = (f"{median(times):.3f} / {max(times):.3f} s" for times in (seen, confirmed))
            print(f"| {text} | {' | '.join(cells)} |", flush=True)


if __name__ == "__main__":
    if len(sys.argv) > 2:
        KINDS[sys.argv[1]](sys.argv[2], sys.argv[3])
    else:
        main(*(int(value) for value in sys.argv[1:2]))
