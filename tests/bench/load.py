"""How fast a stop is while others load the bus: ``python -m tests.bench.load`` (or ``make bench-load``).

Twenty stops for each kind of load. "At the camera" is from the stop's sending to the simulator taking the order, by the
simulator's own time; "confirmed" is until the operator has the answer, which waits for proven rest.
Exit 1 where a limit is missed.
"""

from __future__ import annotations

import json
import math
import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from statistics import median

import zenoh
from zenoh.handlers import Callback

from tests.bench.site import RIG, ROOT, LiveRig

STOPS = 20
CLIENTS = 5
PER_CLIENT_HZ = 200.0
LOOKERS = 20
ANSWER_S = 5.0
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


def flood(
    endpoint: str,
    name: str,
    for_s: float = 600.0,
    rate_hz: float = PER_CLIENT_HZ,
    accepted: Callable[[str], object] = id,
) -> None:
    """Requests by query and by put in turn; ``accepted`` is told the ids of those that were, in Zenoh's thread."""
    answered: list[bool] = []

    def hear(reply: zenoh.Reply) -> None:
        if reply.ok is not None:
            accepted(json.loads(reply.ok.payload.to_bytes())["id"])

    with open_session(endpoint) as session:
        started, sent = time.monotonic(), 0
        while time.monotonic() - started < for_s:
            while sent < (time.monotonic() - started) * rate_hz:
                payload = body(f"{name}-{sent}", hold_s=0.5, priority=sent % 3)
                if sent % 2:
                    session.put(f"{PREFIX}/roi", payload)
                else:
                    callback = Callback(hear, lambda: answered.append(True), indirect=False)
                    session.get(f"{PREFIX}/roi", callback, payload=payload, timeout=ANSWER_S)
                sent += 1
            time.sleep(0.005)
        end = time.monotonic() + 2 * ANSWER_S
        while len(answered) < (sent + 1) // 2 and time.monotonic() < end:
            time.sleep(0.05)


def look(endpoint: str) -> None:
    """Questions for all results, several at once, again and again."""
    with open_session(endpoint) as session:
        started = time.monotonic()
        while time.monotonic() - started < 600:
            asked = [session.get(f"{PREFIX}/roi/*/result", timeout=30.0) for _ in range(LOOKERS)]
            for handler in asked:
                for _ in handler:
                    pass


def listen_and_stall(endpoint: str, leaf: str = "image/*") -> None:
    """Listen to something, then stop reading: a closed laptop, a debugger."""
    with open_session(endpoint) as session:
        seen = threading.Event()
        session.declare_subscriber(f"{PREFIX}/{leaf}", lambda sample: seen.set())
        seen.wait(20)
        os.kill(os.getpid(), signal.SIGSTOP)


def ask_and_stall(endpoint: str) -> None:
    """Ask for more than a connection holds, pictures and results, and read none of it."""
    with open_session(endpoint) as session:
        asked = [
            session.get(f"{PREFIX}/{leaf}", timeout=60.0)
            for _ in range(LOOKERS)
            for leaf in ("image/fisheye", "roi/*/result", "status")
        ]
        os.kill(os.getpid(), signal.SIGSTOP)
        del asked


@contextmanager
def loaded(endpoint: str, crowd: Mapping[str, int]) -> Iterator[None]:
    """Some processes of this module beside, so many of each kind, ended by their ids."""
    command = [sys.executable, "-m", "tests.bench.load"]
    processes = [
        subprocess.Popen([*command, kind, endpoint, f"c{number}-{time.time_ns()}"], cwd=ROOT)
        for kind, count in crowd.items()
        for number in range(count)
    ]
    time.sleep(3.0 if processes else 0.0)
    try:
        yield
    finally:
        for process in processes:
            process.send_signal(signal.SIGKILL)
            process.wait()


def one_stop(rig: LiveRig, session: zenoh.Session, number: int) -> tuple[float, float]:
    """Seconds until the camera has the stop, and until it is confirmed; infinite when the answer is another."""
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
    confirmed = all(answer.ok is not None for answer in answers)
    return (seen_ns - sent_ns) / 1e9, (answered_ns - sent_ns) / 1e9 if confirmed else math.inf


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


KINDS: dict[str, Callable[[str, str], object]] = {
    "flood": flood,
    "look": lambda endpoint, name: look(endpoint),
    "stall": lambda endpoint, name: listen_and_stall(endpoint),
    "stall-all": lambda endpoint, name: listen_and_stall(endpoint, "**"),
    "stall-asking": lambda endpoint, name: ask_and_stall(endpoint),
}
LOADS: tuple[tuple[str, dict[str, int]], ...] = (
    ("nothing else", {}),
    ("five clients, 1,000 requests a second", {"flood": CLIENTS}),
    ("20 wildcard questions for results at once, for ever", {"look": 1}),
    ("the five clients and the questions together", {"flood": CLIENTS, "look": 1}),
    ("a stopped image listener", {"stall": 1}),
    ("three stopped image listeners", {"stall": 3}),
    ("an app that asked for much and stopped", {"stall-asking": 1}),
    ("an app that listens to everything and stopped, under the flood", {"flood": CLIENTS, "stall-all": 1}),
)
AT_CAMERA_S = (0.2, 0.5)
"""Median and largest time until the camera has the stop."""
CONFIRMED_LATER_S = 0.3
"""Most that the median of the confirmations may be later than without load."""


def too_late(found: list[tuple[float, float]], unloaded: list[tuple[float, float]]) -> list[str]:
    """What of the limits does not hold."""
    seen, confirmed = zip(*found, strict=True)
    later = median(confirmed) - median(second for _, second in unloaded)
    checks = (
        ("the median at the camera", median(seen), AT_CAMERA_S[0]),
        ("the largest at the camera", max(seen), AT_CAMERA_S[1]),
        ("the confirmation, against nothing else,", later, CONFIRMED_LATER_S),
    )
    return [f"{what} is {value:.3f} s, limit {limit:g} s" for what, value, limit in checks if value > limit]


def main(stops: int = STOPS) -> int:
    print("| load | stop at the camera, median / largest | confirmed, median / largest |")
    print("|---|---|---|")
    wrong: list[str] = []
    unloaded: list[tuple[float, float]] = []
    with tempfile.TemporaryDirectory() as folder, LiveRig(Path(folder)) as rig:
        wait_until_serving(rig)
        for text, crowd in LOADS:
            with loaded(rig.endpoint, crowd):
                found = measure(rig, stops)
            unloaded = unloaded or found
            seen, confirmed = zip(*found, strict=True)
            cells = (f"{median(times):.3f} / {max(times):.3f} s" for times in (seen, confirmed))
            print(f"| {text} | {' | '.join(cells)} |", flush=True)
            wrong += [f"{text}: {fault}" for fault in too_late(found, unloaded)]
    print("\n".join(f"TOO LATE {fault}" for fault in wrong) if wrong else "all within their limits")
    return 1 if wrong else 0


if __name__ == "__main__":
    if len(sys.argv) > 2:
        KINDS[sys.argv[1]](sys.argv[2], sys.argv[3])
    else:
        sys.exit(main(*(int(value) for value in sys.argv[1:2])))
