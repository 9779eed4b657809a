"""Every fault of the camera in every state of the machine: a named end, one result, and a lock when the fault is over.

The suite takes every fault in one state and every state with one or two faults; ``make matrix`` takes all cells.
``python tests/e2e/test_matrix.py`` prints the table of declared ends, which is the one in docs/axis.md.
"""

from __future__ import annotations

import asyncio
import os
from contextvars import ContextVar
from dataclasses import dataclass
from pathlib import Path

import pytest

from ptzd.devices.vapix.client import CameraClient
from ptzd.errors import RequestRefused
from ptzd.runtime.perception import ThreadPerception
from ptzd.sim.faults import Fault, FaultKind

PAGE = Path(__file__).parents[2] / "docs" / "axis.md"
SPEED = "PTZ.UserAdv.U1.MoveSpeed"
PTZ, EVERYTHING = "*/ptz.cgi*", "*"
FAULTS = {
    "time-out": Fault(kind=FaultKind.HANG, path=PTZ),
    "401": Fault(kind=FaultKind.STATUS, status=401, path=EVERYTHING),
    "403": Fault(kind=FaultKind.STATUS, status=403, path=PTZ),
    "503": Fault(kind=FaultKind.STATUS, status=503, path=EVERYTHING),
    "reset": Fault(kind=FaultKind.RESET, path=EVERYTHING),
    "slow answers": Fault(kind=FaultKind.SLOW, delay_s=0.3, path=PTZ),
    "wrong content type": Fault(kind=FaultKind.HTML, path=PTZ),
    "`Error:` in a 200": Fault(kind=FaultKind.ERROR_TEXT, path=PTZ),
    "garbage numbers": Fault(kind=FaultKind.GARBAGE, path=PTZ),
    "truncated JPEG": Fault(kind=FaultKind.TRUNCATE),
    "stalled stream": Fault(kind=FaultKind.STALL),
    "reboot": Fault(kind=FaultKind.REBOOT),
    "foreign motion": Fault(kind=FaultKind.FOREIGN_MOVE, pan=40.0, tilt=5.0, zoom=1.0),
}
STATES = ("IDLE", "SCAN", "MATCH", "LOCK", "held", "HOME", "FAULT")
"""SCAN: in motion; LOCK: centring, at rest; held: after it; FAULT: while the fisheye is unplugged."""
ATTEMPTS = 3
ASKING = frozenset({"SCAN", "MATCH", "LOCK", "held"})
"""A request is active here when the fault comes."""


@dataclass(frozen=True, slots=True, kw_only=True)
class End:
    """Where a cell ends."""

    state: str
    outcome: str | None = None
    """Of the active request."""

    def __str__(self) -> str:
        return self.state if self.outcome is None else f"{self.state}, `{self.outcome}`"


def declared(fault: str, state: str) -> End:
    """What has to come of a fault in a state."""
    asking = state in ASKING
    if state == "FAULT":
        return End(state="FAULT")
    if fault == "foreign motion":
        # While the head is on its own way, somebody else's order is told from where it comes to rest.
        taken = "unreachable" if state == "SCAN" else "preempted"
        return End(state="IDLE", outcome=taken if asking else None)
    if fault == "slow answers":
        return End(state="IDLE", outcome="released" if asking else None)
    return End(state="FAULT", outcome="device_lost" if asking else None)


def faults_in(state: str) -> list[str]:
    """The faults that are tried in a state: its share, or all of them."""
    if os.environ.get("PTZD_MATRIX") == "all":
        return list(FAULTS)
    return list(FAULTS)[STATES.index(state) :: len(STATES)]


def table() -> str:
    """All cells as Markdown."""
    lines = [f"| fault | {' | '.join(STATES)} |", "|---" * (len(STATES) + 1) + "|"]
    lines += [f"| {fault} | {' | '.join(str(declared(fault, state)) for state in STATES)} |" for fault in FAULTS]
    return "\n".join(lines)


GATE: ContextVar[asyncio.Event] = ContextVar("gate")


@pytest.fixture
def impatient(monkeypatch: pytest.MonkeyPatch) -> None:
    """A short pause after a refusal, and matches that last until the gate of their daemon is open."""
    monkeypatch.setitem(CameraClient.__init__.__kwdefaults__, "refusal_pause_s", 0.5)
    begin, match = ThreadPerception.__init__, ThreadPerception.match

    def gated(self, rig) -> None:
        begin(self, rig)
        self.gate = GATE.get()

    async def patient(self, job, fisheye_jpeg, view_jpeg):
        await self.gate.wait()
        return await match(self, job, fisheye_jpeg, view_jpeg)

    monkeypatch.setattr(ThreadPerception, "__init__", gated)
    monkeypatch.setattr(ThreadPerception, "match", patient)


class Column:
    """One state of the machine: a rig that goes through all faults."""

    def __init__(self, site, state: str, gate: asyncio.Event) -> None:
        self.site = site
        self.state = state
        self.gate = gate
        self.wrong: list[str] = []

    async def run(self) -> None:
        self.gate.set()
        await self.site.start()
        await self.site.lock("before")
        for fault in faults_in(self.state):
            try:
                found = await self.cell(fault)
            except (AssertionError, TimeoutError) as error:
                error.add_note(f"{fault} in {self.state}; the rig is in {self.site.status}")
                raise
            if found != declared(fault, self.state):
                self.wrong.append(f"{fault} in {self.state}: {found} instead of {declared(fault, self.state)}")
        await self.site.lock("after")

    async def cell(self, fault: str) -> End:
        """Bring the machine into the state, let the fault come and go, and lock afterwards."""
        site, name = self.site, f"{self.state} {fault}".replace(" ", "-").replace("`", "").replace(":", "")
        await self.reach(name)
        told = len(site.statuses)
        site.rig.inject(FAULTS[fault])
        end = await self.end(fault, name, told)
        site.rig.camera.faults.clear()
        self.gate.set()
        if self.state == "FAULT":
            await site.rig.fisheye.plug_in()
        await site.until(lambda: site.state not in {"FAULT", "STARTING"} and len(site.statuses) > told)
        if fault == "foreign motion":
            await self.rest()
        if self.state != "held":  # there the next cell begins with a lock
            await self.recover(name)
        return end

    async def recover(self, name: str) -> None:
        """A fresh request locks; on a starved machine the camera may be silent for long enough to be lost once more."""
        for attempt in range(ATTEMPTS):
            await self.site.request(f"{name}-after-{attempt}")
            if (await self.site.end_of(f"{name}-after-{attempt}")).outcome == "locked":
                return
            await self.site.until(lambda: self.site.state in {"IDLE", "HOME"})
        raise AssertionError(f"{name}: no lock in {ATTEMPTS} attempts")

    async def reach(self, name: str) -> None:
        site = self.site
        if self.state in ASKING:
            await self.ask(name)
        elif self.state == "FAULT":
            await site.rig.fisheye.unplug()
            await site.until_state("FAULT")
            await self.rest()
        else:
            await site.until_state("HOME")
            await site.until_state(self.state)

    async def ask(self, name: str) -> None:
        """A request that is brought as far as this column goes; it stays there."""
        site, parameters = self.site, self.site.rig.camera.unit.parameters
        if self.state == "MATCH":
            self.gate.clear()
        if self.state == "SCAN":
            parameters[SPEED] = "40"  # 9°/s: long enough on the way
        await site.request(name, hold_s=120.0)
        await (site.until_locked(name) if self.state == "held" else site.until_state(self.state))
        if self.state == "SCAN":
            await site.until_truth(lambda: site.moving)
            parameters[SPEED] = "100"
            return
        if self.state == "LOCK":
            self.gate.clear()
        await self.rest()

    async def rest(self) -> None:
        """Until the head stands, and the daemon has had a second to see it."""
        site = self.site
        await site.until_truth(lambda: not site.rig.camera.unit.head.busy(site.rig.clock.now_s()))
        told = len(site.statuses)
        await site.until(lambda: len(site.statuses) > told + 1)

    async def end(self, fault: str, name: str, told: int) -> End:
        """The state and the result that the fault brings."""
        site, want = self.site, declared(fault, self.state)
        if fault == "foreign motion":
            await site.until_truth(lambda: not site.moving and bool(site.orders))
        elif self.state == "FAULT" and fault != "slow answers":
            await site.until(lambda: site.status.ptz != "well")
        if fault == "slow answers" and self.state in ASKING:
            self.gate.set()
            await site.until_locked(name)
            await site.client.control("release")
        outcome = (await site.end_of(name)).outcome if self.state in ASKING else None
        await site.until(lambda: want.state in {status.state for status in site.statuses[told + 1 :]})
        if want.state == "FAULT":
            with pytest.raises(RequestRefused) as refused:
                await site.client.request(box=site.box, id=f"{name}-meanwhile")
            assert refused.value.code == "device_lost"
        return End(state=want.state, outcome=outcome)


@pytest.mark.timeout(900)
@pytest.mark.parametrize("states", [("IDLE", "SCAN", "HOME", "FAULT"), ("MATCH", "LOCK", "held")], ids="-".join)
async def test_every_fault_in_every_state(make_site, impatient, states: tuple[str, ...]) -> None:
    columns = []
    for state in states:
        site = await make_site(boot_s=3.0, fisheye_fps=4.0)
        site.change(ptz={"fps": 8.0, "stall_s": 6.0}, fisheye={"stall_s": 20.0}, log={"rotate_s": 3600.0})
        columns.append(Column(site, state, asyncio.Event()))

    async def run(column: Column) -> None:
        GATE.set(column.gate)
        await column.run()

    async with asyncio.TaskGroup() as running:
        for column in columns:
            running.create_task(run(column), name=column.state)
    assert [line for column in columns for line in column.wrong] == []


def test_the_page_shows_the_declared_ends() -> None:
    assert table() in PAGE.read_text()


if __name__ == "__main__":
    print(table())
