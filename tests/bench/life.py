"""A rig that lives at random: ``python -m tests.bench.life MINUTES [SEED]`` (or ``make life MINUTES=60``).

A simulated rig and the daemon, each a process; clients that request, update, cancel, stop, send home, hold, release,
read and rotate the log; reloads; every fault of the camera and of the fisheye, cuts and reboots; listeners that stop
reading. At the end: every accepted request has exactly one result, memory is flat over the last half, every log
replays. Exit 1 where one of these does not hold.
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
from pathlib import Path
from statistics import median

import yaml

from ptzd.bus.client import Client
from ptzd.bus.messages import RoiResult
from ptzd.errors import BusError, PtzdError
from tests.bench.load import listen_and_stall, wait_until_serving
from tests.bench.site import RIG, LiveRig

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
    {"kind": "stall", "for_s": 3, "device": "fisheye"},
    {"kind": "unplug", "for_s": 5},
    {"kind": "unplug", "for_s": 5, "device": "fisheye"},
    {"kind": "reboot"},
)
GROWTH = 0.02
"""Of resident memory from the third quarter to the last: more than this is growth."""
QUARTERS = 4


class Life:
    """One run."""

    def __init__(self, rig: LiveRig, seconds: float, seed: int) -> None:
        self.rig = rig
        self.seconds = seconds
        self.done: Counter[str] = Counter()
        self.refused: Counter[str] = Counter()
        self.accepted: set[str] = set()
        self.results: defaultdict[str, list[str]] = defaultdict(list)
        self.memory_kib: list[int] = []
        self._chance = random.Random(seed)
        self._settings = yaml.safe_load(rig.config.read_text())
        self._names: list[str] = []
        self._stalled: list[subprocess.Popen[bytes]] = []

    async def run(self) -> None:
        async with Client.open(self.rig.endpoint, rig=RIG, timeout_s=5.0) as client:
            hearing = asyncio.create_task(self._hear(client))
            troubling = asyncio.create_task(self._trouble())
            updating = asyncio.create_task(self._update_fast(client))
            try:
                await self._act(client)
            finally:
                for task in (troubling, updating):
                    task.cancel()
                for process in self._stalled:
                    process.send_signal(signal.SIGKILL)
                    process.wait()
                await asyncio.gather(troubling, updating, return_exceptions=True)
            await self._end(client)
            hearing.cancel()
            await asyncio.gather(hearing, return_exceptions=True)

    async def _hear(self, client: Client) -> None:
        async for notice in client.watch():
            if isinstance(notice, RoiResult):
                self.results[notice.id].append(str(notice.outcome))

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
        if self._chance.random() < 0.1:
            name = self._chance.choice(self._names)
        accepted = await client.request(
            box=self._box(),
            id=name,
            hold_s=self._chance.choice((0.0, 1.0, 3.0)),
            timeout_s=self._chance.choice((1.0, 5.0, 20.0)),
            priority=self._chance.choice((0, 0, 0, 5, 9)),
        )
        self.accepted.add(accepted.id)
        self.done["request"] += 1

    async def _update_fast(self, client: Client) -> None:
        """A tracker: now and then twenty updates a second for whoever is served."""
        while True:
            await asyncio.sleep(self._chance.uniform(5, 20))
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
            await asyncio.sleep(self._chance.uniform(8, 25))
            fault = dict(self._chance.choice(FAULTS))
            try:
                await asyncio.to_thread(self.rig.ask_truth, "/truth/fault", fault)
            except (urllib.error.URLError, OSError):
                self.refused["fault"] += 1
                continue
            self.done[f"fault {fault.get('device', 'ptz')} {fault['kind']}"] += 1
            if self._chance.random() < 0.15:
                self._stalled.append(await asyncio.to_thread(stalled_listener, self.rig.endpoint))
                self.done["stalled listener"] += 1
            for process in self._stalled[:-2]:
                process.send_signal(signal.SIGKILL)
                process.wait()
            del self._stalled[:-2]

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
        for name in sorted(self.accepted - self.results.keys()):
            try:
                self.results[name].append(str((await client.result(name, timeout_s=5.0)).outcome))
            except BusError:
                continue

    def growth(self) -> float:
        """Share by which memory rose from the third quarter to the last."""
        quarter = max(len(self.memory_kib) // QUARTERS, 1)
        third = median(self.memory_kib[2 * quarter : 3 * quarter] or self.memory_kib)
        last = median(self.memory_kib[3 * quarter :] or self.memory_kib)
        return last / third - 1.0

    def faults(self) -> list[str]:
        """What does not hold."""
        wrong = [
            f"{name}: {len(self.results[name])} results: {', '.join(self.results[name])}"
            for name in sorted(self.accepted)
            if len(self.results[name]) != 1
        ]
        if self.growth() > GROWTH:
            wrong.append(f"memory grew by {self.growth():.1%} over the last half")
        return wrong


def stalled_listener(endpoint: str) -> subprocess.Popen[bytes]:
    """A process that listens to pictures and then reads no more."""
    return subprocess.Popen([sys.executable, "-m", "tests.bench.life", "stall", endpoint])


def replays(folder: Path) -> list[str]:
    """Files of the log that do not replay the same."""
    wrong = []
    for path in sorted((folder / "log").glob("*.mcap")):
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
        if status != 0:
            wrong.append(f"the daemon's end: exit {status}")
        files = len(list((folder / "log").glob("*.mcap")))
        outcomes = Counter(outcome for told in life.results.values() for outcome in told)
        memory = [
            life.memory_kib[min(len(life.memory_kib) - 1, len(life.memory_kib) * n // 8)] // 1024 for n in range(9)
        ]
        print(f"{minutes:g} min, seed {seed}: {dict(sorted(life.done.items()))}")
        print(f"refused: {dict(life.refused)}")
        print(f"accepted {len(life.accepted)}, results {dict(outcomes)}")
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
    if sys.argv[1] == "stall":
        listen_and_stall(sys.argv[2])
    else:
        sys.exit(main(float(sys.argv[1]), *(int(value) for value in sys.argv[2:3])))
