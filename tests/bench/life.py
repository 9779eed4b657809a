"""A rig that lives at random: ``python -m tests.bench.life MINUTES [SEED]`` (or ``make life MINUTES=60``).

A simulated rig and the daemon, each a process; clients that request, update, cancel, stop, send home, hold, release,
read and rotate the log; reloads; every fault of the camera and of the fisheye, cuts and reboots; floods of requests;
apps that listen or ask and then stop reading; people who take the head and move it by hand. At the end: every accepted
request has exactly one result, memory is flat over the last half, every log replays. Exit 1 where one of these does not
hold.
"""

from __future__ import annotations

import asyncio
import json
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
import urllib.error
from collections import Counter, defaultdict
from collections.abc import Iterable
from pathlib import Path
from statistics import median

import yaml

from ptzd.bus.client import Client
from ptzd.bus.messages import RoiResult, Status
from ptzd.errors import BusError, PtzdError
from tests.bench.load import flood, wait_until_serving
from tests.bench.people import People
from tests.bench.site import RIG, ROOT, LiveRig

FAULTS: tuple[dict[str, object], ...] = (
    {"kind": "hang", "for_s": 4, "path": "*/ptz.cgi*"},
    {"kind": "status", "for_s": 3, "status": 503},
    {"kind": "reset", "count": 2, "path": "*query=position*"},
    {"kind": "slow", "for_s": 5, "delay_s": 0.4, "path": "*/ptz.cgi*"},
    {"kind": "html", "count": 3, "path": "*query=position*"},
    {"kind": "garbage", "count": 2, "path": "*query=position*"},
    {"kind": "empty", "count": 1, "path": "*query=position*"},
    {"kind": "forget_nonces"},
    {"kind": "foreign_move", "pan": 40.0, "tilt": -20.0, "zoom": 500},
    {"kind": "recalibrate"},
    {"kind": "stall", "for_s": 6},
    {"kind": "truncate", "count": 5},
    {"kind": "corrupt", "count": 3},
    {"kind": "cut", "count": 1},
    {"kind": "short", "count": 2},
    {"kind": "guesses"},
    {"kind": "error_text", "count": 1, "path": "*/ptz.cgi*pan=*"},
    {"kind": "stall", "for_s": 3, "device": "fisheye"},
    {"kind": "cut", "count": 1, "device": "fisheye"},
    {"kind": "truncate", "count": 3, "device": "fisheye"},
    {"kind": "corrupt", "count": 3, "device": "fisheye"},
    {"kind": "short", "count": 2, "device": "fisheye"},
    {"kind": "status", "for_s": 3, "status": 503, "device": "fisheye"},
    {"kind": "unplug", "for_s": 5},
    {"kind": "unplug", "for_s": 5, "device": "fisheye"},
    {"kind": "reboot"},
)
GROWTH = 0.02
"""Of resident memory from the third quarter to the last: more than this is growth."""
SLOW = frozenset({"guesses"})
"""After these the daemon asks a camera only once a minute: not in a short life."""
QUARTERS = 4
SETTLED_S = 600.0
"""A daemon takes up its memory within the first minutes: in a life shorter than this, growth says nothing."""
STALLS = ("stall", "stall-all", "stall-asking")
FLOOD_S, FLOOD_HZ = 3.0, 400.0
KNOWN_S = 500.0
LONGEST_S = 30.0
"""From the last request of a flood to its result."""


class Life:
    """One run."""

    def __init__(self, rig: LiveRig, seconds: float, seed: int) -> None:
        self.rig = rig
        self.seconds = seconds
        self.done: Counter[str] = Counter()
        self.refused: Counter[str] = Counter()
        self.accepted: set[str] = set()
        self.results: defaultdict[str, list[str]] = defaultdict(list)
        """As published."""
        self.kept: dict[str, str] = {}
        """Of those whose publication this process missed, on asking."""
        self.doubts: list[str] = []
        """No fault here makes the head a liar: each is a false alarm."""
        self.memory_kib: list[int] = []
        self._chance = random.Random(seed)
        self._faults = [fault for fault in FAULTS if seconds >= SETTLED_S or fault["kind"] not in SLOW]
        self._pace = min(max(seconds / SETTLED_S, 0.1), 1.0)
        """A short life is an eventful one."""
        self._settings = yaml.safe_load(rig.config.read_text())
        self._names: list[str] = []
        self._asked: dict[str, float] = {}
        self._stalled: list[subprocess.Popen[bytes]] = []

    async def run(self) -> None:
        async with Client.open(self.rig.endpoint, rig=RIG, timeout_s=5.0) as client:
            hearing = asyncio.create_task(self._hear(client))
            beside = [
                asyncio.create_task(work)
                for work in (
                    self._trouble(),
                    self._stall(),
                    self._update_fast(client),
                    self._flood(client),
                    self._people(client),
                )
            ]
            try:
                await self._act(client)
            finally:
                for task in beside:
                    task.cancel()
                for process in self._stalled:
                    process.send_signal(signal.SIGKILL)
                    process.wait()
                await asyncio.gather(*beside, return_exceptions=True)
            await self._end(client)
            hearing.cancel()
            await asyncio.gather(hearing, return_exceptions=True)

    async def _hear(self, client: Client) -> None:
        async for notice in client.watch():
            if isinstance(notice, RoiResult):
                self.results[notice.id].append(str(notice.outcome))
            elif isinstance(notice, Status) and notice.doubt not in {"", *self.doubts}:
                self.doubts.append(notice.doubt)

    async def _act(self, client: Client) -> None:
        end = time.monotonic() + self.seconds
        while time.monotonic() < end:
            if self.rig.daemon is None or self.rig.daemon.poll() is not None:
                raise SystemExit("the daemon ended; see its journal")
            try:
                await self._one(client)
            except PtzdError as error:
                code = getattr(error, "code", type(error).__name__)
                self.refused[str(code)] += 1
            self.memory_kib.append(self.rig.resident_kib)
            await asyncio.sleep(self._chance.choice((0.05, 0.3, 1.0, 2.0)))

    async def _pause(self, low_s: float, high_s: float) -> None:
        await asyncio.sleep(self._chance.uniform(low_s, high_s) * self._pace)

    async def _one(self, client: Client) -> None:
        chance = self._chance.random()
        if chance < 0.45:
            await self._request(client)
        elif chance < 0.55 and self._names:
            await client.cancel(self._chance.choice(self._names[-5:]))
            self.done["cancel"] += 1
        elif chance < 0.62 and self._names:
            await client.update(self._chance.choice(self._names[-3:]), self._box())
            self.done["update"] += 1
        elif chance < 0.82:
            verb = self._chance.choice(("stop", "home", "hold", "release", "release"))
            await client.control(verb)
            self.done[verb] += 1
        elif chance < 0.86:
            self._reload()
        elif chance < 0.89:
            await client.log_files(rotate=self._chance.random() < 0.3)
            self.done["log"] += 1
        else:
            self.done[f"seen {(await client.status()).state}"] += 1

    def _box(self) -> tuple[float, float, float, float]:
        if self._chance.random() < 0.5:
            return (self._chance.choice((310.0, 250.0, 350.0)), self._chance.choice((220.0, 200.0)), 40.0, 32.0)
        side = self._chance.choice((8.0, 20.0, 40.0, 80.0))
        return (self._chance.uniform(0, 600), self._chance.uniform(0, 440), side, side)

    async def _request(self, client: Client) -> None:
        name = f"life-{len(self._names)}"
        self._names.append(name)
        self._asked[name] = time.monotonic()
        if self._chance.random() < 0.1:
            name = self._known()
        accepted = await client.request(
            box=self._box(),
            id=name,
            hold_s=self._chance.choice((0.0, 1.0, 3.0)),
            timeout_s=self._chance.choice((1.0, 5.0, 20.0)),
            priority=self._chance.choice((0, 0, 0, 5, 9)),
        )
        self.accepted.add(accepted.id)

    def _known(self) -> str:
        """An id that was asked for lately: the daemon still knows how it ended (``queue.results_kept_s``)."""
        latest = time.monotonic() - KNOWN_S
        return self._chance.choice([name for name, asked in self._asked.items() if asked > latest])

    async def _people(self, client: Client) -> None:
        chance = random.Random(self._chance.random())
        people = People(client, chance, self.done, self.refused, self.accepted.add)
        while True:
            await self._pause(20, 90)
            await people.come()

    async def _update_fast(self, client: Client) -> None:
        """A tracker: now and then twenty updates a second for whoever is served."""
        while True:
            await self._pause(5, 20)
            for _ in range(60):
                if self._names:
                    try:
                        await client.update(self._names[-1], self._box())
                    except PtzdError:
                        self.refused["update"] += 1
                await asyncio.sleep(0.05)
            self.done["burst of updates"] += 1

    async def _trouble(self) -> None:
        while True:
            await self._pause(8, 25)
            fault = dict(self._chance.choice(self._faults))
            try:
                await asyncio.to_thread(self.rig.ask_truth, "/truth/fault", fault)
            except (urllib.error.URLError, OSError):
                self.refused["fault"] += 1
                continue
            self.done[f"fault {fault.get('device', 'ptz')} {fault['kind']}"] += 1

    async def _stall(self) -> None:
        """Apps that stop reading; the last two of them stay."""
        while True:
            await self._pause(3, 200)
            kind = self._chance.choice(STALLS)
            command = [sys.executable, "-m", "tests.bench.load", kind, self.rig.endpoint, "stalled"]
            self._stalled.append(subprocess.Popen(command, cwd=ROOT))  # noqa: ASYNC220 - a fork is short
            self.done[kind] += 1
            for process in self._stalled[:-2]:
                process.send_signal(signal.SIGKILL)
                process.wait()
            del self._stalled[:-2]

    async def _flood(self, client: Client) -> None:
        while True:
            await self._pause(2, 120)
            name = f"flood-{self.done['flood']}"
            self.done["flood"] += 1
            await asyncio.to_thread(flood, self.rig.endpoint, name, FLOOD_S, FLOOD_HZ, self.accepted.add)
            await asyncio.sleep(LONGEST_S)
            await self._ask_for_missed(client, [known for known in self.accepted if known.startswith(f"{name}-")])

    def _reload(self) -> None:
        document = json.loads(json.dumps(self._settings))
        document.setdefault("search", {})["accept_probability"] = self._chance.choice((0.7, 0.8, 0.9))
        document.setdefault("queue", {})["size"] = self._chance.choice((0, 2, 8))
        document["log"]["fisheye_every_n"] = self._chance.choice((1, 3))
        text = yaml.safe_dump(document) + self._chance.choice(
            ("", "", "", "\nnonsense: [", "\nunknown: 1\n", "\nrig: twice\n")
        )
        fresh = self.rig.config.with_suffix(".new")
        fresh.write_text(text)
        fresh.replace(self.rig.config)
        assert self.rig.daemon is not None
        os.kill(self.rig.daemon.pid, signal.SIGHUP)
        self.done["reload"] += 1

    async def _end(self, client: Client) -> None:
        """Faults off, everything released and stopped, and time for the last results."""
        await asyncio.to_thread(self.rig.ask_truth, "/truth/fault", None, "DELETE")
        deadline = time.monotonic() + 60
        while time.monotonic() < deadline:
            try:
                await client.control("release")
                await client.control("stop")
                if (await client.status()).state in {"IDLE", "HOME"}:
                    break
            except PtzdError:
                pass
            await asyncio.sleep(1.0)
        await asyncio.sleep(3.0)
        await self._ask_for_missed(client, self.accepted)

    async def _ask_for_missed(self, client: Client, names: Iterable[str]) -> None:
        """Results are kept for ten minutes, for whoever missed that they were published."""
        for name in sorted(set(names) - self.results.keys() - self.kept.keys()):
            try:
                self.kept[name] = str((await client.result(name, timeout_s=5.0)).outcome)
            except BusError:
                continue

    def told(self, name: str) -> list[str]:
        """The results of one request."""
        return self.results.get(name) or [self.kept[name] for _ in range(name in self.kept)]

    def growth(self) -> float:
        """Share by which memory rose from the third quarter to the last."""
        quarter = max(len(self.memory_kib) // QUARTERS, 1)
        third = median(self.memory_kib[2 * quarter : 3 * quarter] or self.memory_kib)
        last = median(self.memory_kib[3 * quarter :] or self.memory_kib)
        return last / third - 1.0

    def faults(self) -> list[str]:
        """What does not hold."""
        wrong = [
            f"{name}: {len(self.told(name))} results: {', '.join(self.told(name))}"
            for name in sorted(self.accepted)
            if len(self.told(name)) != 1
        ]
        wrong += [f"the head was doubted: {doubt}" for doubt in self.doubts]
        if self.seconds >= SETTLED_S and self.growth() > GROWTH:
            wrong.append(f"memory grew by {self.growth():.1%} over the last half")
        return wrong


def replays(folder: Path) -> list[str]:
    """Files of the log that do not replay the same."""
    wrong = []
    paths = sorted((folder / "log").glob("*.mcap"))
    if not paths:
        return ["no log was written"]
    for path in paths:
        command = [sys.executable, "-m", "ptzd", "replay", str(path)]
        found = subprocess.run(command, capture_output=True, text=True, check=False)
        if found.returncode != 0:
            wrong.append(f"{path.name}: replay exits with {found.returncode}: {found.stdout[:400]}{found.stderr[:200]}")
    return wrong


def main(minutes: float, seed: int = 7) -> int:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        settings = {"log": {"rotate_s": 60.0, "keep_bytes": 4_000_000_000}}
        with LiveRig(folder, settings=settings) as rig:
            wait_until_serving(rig)
            life = Life(rig, minutes * 60, seed)
            asyncio.run(life.run())
            status = rig.stop_daemon()
        wrong = life.faults() + replays(folder)
        if not life.accepted:
            wrong.append("no request was accepted")
        if status != 0:
            wrong.append(f"the daemon's end: exit {status}")
        files = len(list((folder / "log").glob("*.mcap")))
        outcomes = Counter(outcome for request in life.accepted for outcome in life.told(request))
        memory = [
            life.memory_kib[min(len(life.memory_kib) - 1, len(life.memory_kib) * n // 8)] // 1024 for n in range(9)
        ]
        print(f"{minutes:g} min, seed {seed}: {dict(sorted(life.done.items()))}")
        print(f"refused: {dict(life.refused)}")
        print(f"accepted {len(life.accepted)}, results {dict(outcomes)}, of which {len(life.kept)} on asking")
        print(f"memory, MiB over time: {memory}, {life.growth():+.1%} from the third quarter to the last")
        print(f"logs: {files} files replayed")
        for text in wrong:
            print(f"WRONG {text}")
        if wrong:
            journal = (folder / "journal.txt").read_text().splitlines()
            print("\n".join(journal[-40:]))
        print("all well" if not wrong else f"{len(wrong)} things are wrong")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main(float(sys.argv[1]), *(int(value) for value in sys.argv[2:3])))
