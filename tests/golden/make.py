"""Record the golden logs anew: the simulated rig with small pictures, the real daemon, one log per story.

python tests/golden/make.py [NAME ...]

Prints what the present code makes of each log before it is replaced (which values differ, and where they part), and
how the new story's decisions differ from the old one's.
The pictures show the scene ``room``, which was modelled for this project; they are under its licence.
"""

from __future__ import annotations

import asyncio
import dataclasses
import difflib
import json
import re
import sys
import tempfile
from collections.abc import AsyncIterator, Awaitable, Callable, Iterable
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

import cv2
import yaml

from ptzd.app.daemon import serve
from ptzd.app.loading import load
from ptzd.app.loopback import reserved_port
from ptzd.app.replaying import replay
from ptzd.app.simulate import DEFAULT_PASSWORD, RIG, write_config
from ptzd.bus.by_hand import MoveRequest, PanTilt, Speed, Step
from ptzd.bus.client import Client
from ptzd.bus.messages import LeaseRequest
from ptzd.control import commands as cmd
from ptzd.control import events as ev
from ptzd.errors import RequestRefused
from ptzd.log.file import McapFile
from ptzd.log.reader import LoggedCommand, LoggedEvent, LogReader
from ptzd.log.topics import COMMAND
from ptzd.replay.report import Report, lines
from ptzd.sim.rig import SimRig
from ptzd.sim.settings import SimSettings

HERE = Path(__file__).parent
MUST_FAIL = "tampered"
MAX_BYTES = 2_000_000
PATIENCE_S = 60.0
SIM = SimSettings(scene="room", ptz_size_px=(320, 240), fisheye_fps=5.0, fisheye_quality=80, fisheye_noise_sigma=1.0)
CHANGES = {
    "fisheye": {"stall_s": 10.0},
    "ptz": {"fps": 4.0, "compression": 40, "poll_hz": 4.0},
    "log": {"fisheye_every_n": 1000},
    "home": {"idle_s": 0.5},
}
BOX = (261.0, 197.0, 34.0, 28.0)
NEAR = (265.0, 200.0, 34.0, 28.0)
"""Where the target of the update is said to have gone."""
OUTSIDE = (2.0, 2.0, 20.0, 20.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Site:
    """A running rig."""

    rig: SimRig
    client: Client

    async def until_state(self, state: str) -> None:
        async with asyncio.timeout(PATIENCE_S):
            async for notice in self.client.watch():
                if getattr(notice, "state", None) == state:
                    return

    async def until_there(self, place: str) -> None:
        """Until the patrol is at a place."""
        async with asyncio.timeout(PATIENCE_S):
            async for notice in self.client.watch():
                patrol = getattr(notice, "patrol", None)
                if patrol is not None and (patrol.place, patrol.phase) == (place, "there"):
                    return

    async def until_locked(self, name: str) -> None:
        async with asyncio.timeout(PATIENCE_S):
            async for step in self.client.feedback(name):
                if step.step == "locked":
                    return


Story = Callable[[Site], Awaitable[None]]


async def lock(site: Site) -> None:
    await site.client.request(box=BOX, id="target", hold_s=0.5)
    await site.client.result("target", timeout_s=PATIENCE_S)
    await site.until_state("HOME")


async def refusal(site: Site) -> None:
    for name, box in (("corner", OUTSIDE), ("speck", (261.0, 197.0, 1.0, 1.0))):
        with suppress(RequestRefused):
            await site.client.request(box=box, id=name)
    with suppress(RequestRefused):
        await site.client.request(box=BOX, id="stale", frame_seq=1_000_000)


async def preemption(site: Site) -> None:
    await site.client.request(box=BOX, id="slow", hold_s=60.0)
    await site.until_locked("slow")
    await site.client.request(box=NEAR, id="urgent", hold_s=0.0, priority=5)
    await site.client.result("urgent", timeout_s=PATIENCE_S)


async def device_loss(site: Site) -> None:
    await site.client.request(box=BOX, id="interrupted", hold_s=60.0)
    await site.until_locked("interrupted")
    await site.rig.fisheye.unplug()
    await site.client.result("interrupted", timeout_s=PATIENCE_S)
    await site.rig.fisheye.plug_in()
    await site.until_state("IDLE")


async def update(site: Site) -> None:
    await site.client.request(box=BOX, id="moving", hold_s=3.0)
    await site.until_locked("moving")
    await site.client.update("moving", box=NEAR)
    await site.client.result("moving", timeout_s=PATIENCE_S)


async def lease(site: Site) -> None:
    """Somebody takes the head and is not heard of again; what waited goes on."""
    await site.client.request(box=BOX, id="interrupted", hold_s=60.0)
    await site.until_locked("interrupted")
    await site.client.ask_lease(LeaseRequest(owner="desk"))
    await site.client.result("interrupted", timeout_s=PATIENCE_S)
    await site.until_state("MANUAL")
    await site.client.request(box=NEAR, id="waits", hold_s=0.0)
    await site.client.result("waits", timeout_s=PATIENCE_S)


async def hand(site: Site) -> None:
    """Somebody moves the head by hand and is not heard of again in the middle of it; what waited goes on."""
    client = site.client
    await client.ask_lease(LeaseRequest(owner="desk"))
    await site.until_state("MANUAL")
    await client.request(box=NEAR, id="waits", hold_s=0.0)
    with suppress(RequestRefused):
        await client.move(MoveRequest(owner="desk", to=PanTilt(pan_deg=0.0, tilt_deg=170.0)))
    for _ in range(5):
        await client.move(MoveRequest(owner="desk", speed=Speed(pan_deg_s=20.0, tilt_deg_s=-5.0, zoom_rate=0.2)))
        await asyncio.sleep(0.1)
    await client.move(MoveRequest(owner="desk", by=Step(pan_deg=-3.0, tilt_deg=2.0), hfov_deg=30.0))
    await client.result("waits", timeout_s=PATIENCE_S)


async def zones(site: Site) -> None:
    """Around a lamp, beside a window, not behind a wall, and not at a tree."""
    await site.client.request(box=BOX, id="around", hold_s=0.5)
    await site.client.result("around", timeout_s=PATIENCE_S)
    await site.client.request(box=BEHIND, id="behind", range_m=(2.0, 20.0))
    await site.client.result("behind", timeout_s=PATIENCE_S)
    with suppress(RequestRefused):
        await site.client.request(box=TREE, id="tree")
    await site.until_state("HOME")


async def patrol(site: Site) -> None:
    """Interrupted at a place by a request it goes back there, and on; a goto and a stop go before it too."""
    client = site.client
    await client.patrol("start", "round")
    await site.until_there("left")
    await client.request(box=BOX, id="between", hold_s=0.0)
    await client.result("between", timeout_s=PATIENCE_S)
    await site.until_there("left")
    await site.until_there("right")
    with suppress(RequestRefused):
        await client.goto("behind")
    await client.goto("left", hold_s=0.3)
    await site.until_there("right")
    await client.control("stop")
    await client.patrol("resume")
    await site.until_there("right")
    await client.patrol("stop")
    await site.until_state("HOME")


def _upright(name: str, kind: str, pans: tuple[float, float], tilts: tuple[float, float]) -> dict[str, object]:
    (left, right), (low, high) = pans, tilts
    corners = [[left, low], [right, low], [right, high], [left, high]]
    return {"name": name, "kind": kind, "frame": "head", "corners_deg": corners, "range_m": [1e3, 1e4]}


ZONES = [
    _upright("lamp", "no_go", (-14.0, -6.0), (-18.0, -10.0)),
    _upright("wall-below", "no_go", (30.0, 36.0), (-56.0, -15.0)),
    _upright("wall", "no_go", (30.0, 36.0), (-20.0, 25.0)),
    _upright("wall-above", "no_go", (30.0, 36.0), (20.0, 64.0)),
    _upright("window", "privacy", (-31.0, -26.0), (16.0, 22.0)),
    {
        "name": "tree",
        "kind": "ignore",
        "frame": "fisheye",
        "corners_px": [[170, 170], [230, 170], [230, 230], [170, 230]],
    },
]
BEHIND = (464.0, 224.0, 32.0, 32.0)
TREE = (185.0, 185.0, 30.0, 30.0)
PRESETS = {
    "places": {
        "left": {"azimuth_deg": -20.0, "elevation_deg": -5.0, "hfov_deg": 30.0},
        "right": {"azimuth_deg": 15.0, "elevation_deg": 3.0, "hfov_deg": 45.0},
        "behind": {"azimuth_deg": 180.0, "elevation_deg": 0.0, "hfov_deg": 45.0},
    },
    "patrols": {"round": [{"place": "left", "dwell_s": 3.0}, {"place": "right", "dwell_s": 60.0}]},
}
MORE: dict[str, dict[str, object]] = {"zones": {"zones": ZONES}, "patrol": {"presets": PRESETS}}
"""Settings of single stories, whole parts."""

STORIES: dict[str, Story] = {
    "lock": lock,
    "refusal": refusal,
    "preemption": preemption,
    "device_loss": device_loss,
    "update": update,
    "lease": lease,
    "hand": hand,
    "zones": zones,
    "patrol": patrol,
}


@asynccontextmanager
async def running(folder: Path, more: dict[str, object]) -> AsyncIterator[Site]:
    """Rig and daemon in this process; the log is closed when it is left."""
    stop, ready = asyncio.Event(), asyncio.Event()
    with reserved_port() as port:
        endpoint = f"tcp/127.0.0.1:{port}"
        async with SimRig(SIM) as rig:
            path = write_config(rig, folder, bus=endpoint, password=DEFAULT_PASSWORD)
            document = yaml.safe_load(path.read_text())
            for name, values in CHANGES.items():
                document[name] = {**document.get(name, {}), **values}
            path.write_text(yaml.safe_dump({**document, **more}))
            loaded = load(path)
            anonymous = dataclasses.replace(loaded, config_text=loaded.config_text.replace(f"{folder}/", ""))
            serving = asyncio.create_task(serve(anonymous, stop, ready=ready.set))
            try:
                async with asyncio.timeout(PATIENCE_S):
                    await ready.wait()
                async with Client.open(endpoint, rig=RIG) as client:
                    yield Site(rig=rig, client=client)
            finally:
                stop.set()
                await serving


async def record(name: str) -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        async with running(Path(folder), MORE.get(name, {})) as site:
            await STORIES[name](site)
        (log,) = (Path(folder) / "log").glob("*.mcap")
        return log.read_bytes()


def tampered(source: Path, target: Path) -> int:
    """Copy a log with one set point moved by a thousandth of a degree; returns the sequence number of its event."""
    sequence = 0
    with LogReader(source) as reader:
        entries = list(reader.entries())
        file = McapFile(target, reader.run, entries[0].log_ns)
    file.open()
    for entry in entries:
        data = entry.data
        held = json.loads(data) if entry.topic == COMMAND else {}
        if not sequence and held.get("name") == cmd.MoveHead.__name__:
            sequence, body = held["sequence"], json.loads(held["body"])
            body["target"]["pan_deg"] += 1e-3
            data = json.dumps({**held, "body": json.dumps(body)}).encode()
        file.add(entry.topic, entry.log_ns, entry.publish_ns, entry.sequence, data)
    file.finish()
    return sequence


def told(path: Path) -> Iterable[str]:
    """The decisions of a log as lines without times, ports and numbers that every run has its own of."""
    with LogReader(path) as reader:
        event: ev.Event | None = None
        for logged in reader.decisions():
            if isinstance(logged, LoggedEvent):
                event = logged.event
            elif isinstance(logged, LoggedCommand) and event is not None:
                yield f"{type(event).__name__} → {_line(logged.command)}"


def _line(command: cmd.Command) -> str:
    match command:
        case cmd.PublishFeedback():
            text = f"feedback {command.id} {command.step}"
        case cmd.PublishResult():
            text = f"result {command.id} {command.outcome}: {command.reason}"
        case cmd.PublishStatus():
            text = f"status {command.state} {command.active or '–'} {command.phase} queue {len(command.queue)}"
        case cmd.ReplyRefused():
            text = f"refused {command.code} {command.field}"
        case _:
            text = type(command).__name__
    return re.sub(r"\d+(\.\d+)?", "#", text)


def renew(name: str, fresh: Path) -> None:
    """Put a log into its place and tell what changed."""
    path = HERE / f"{name}.mcap"
    size = fresh.stat().st_size
    assert size <= MAX_BYTES, f"{name}: {size} bytes; at most {MAX_BYTES}"
    before = []
    if path.exists():
        print("\n".join(lines(Report(path=path, replay=replay(path, recompute=True)))))
        before = list(told(path))
    changes = list(difflib.unified_diff(before, list(told(fresh)), f"{name} before", f"{name} now", lineterm="", n=1))
    print("\n".join(changes) if changes else f"{name}: the same decisions in the same order")
    path.write_bytes(fresh.read_bytes())
    print(f"{name}: {size / 1e3:.0f} kB")


def main(names: list[str]) -> None:
    cv2.setNumThreads(1)
    for name in names or STORIES:
        with tempfile.TemporaryDirectory() as folder:
            fresh = Path(folder) / f"{name}.mcap"
            fresh.write_bytes(asyncio.run(record(name)))
            found = replay(fresh, recompute=True)
            assert found.same, [str(difference) for difference in found.differences]
            renew(name, fresh)
            if name == "lock":
                bad = Path(folder) / f"{MUST_FAIL}.mcap"
                print(f"{MUST_FAIL}: the set point answered to event {tampered(fresh, bad)} is another one")
                renew(MUST_FAIL, bad)


if __name__ == "__main__":
    main(sys.argv[1:])
