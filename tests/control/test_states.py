"""The table of states, pair by pair: what may follow what, and what must never happen."""

from __future__ import annotations

import itertools
import re
from pathlib import Path

import pytest

from ptzd.control import commands as cmd
from ptzd.control import events as ev
from ptzd.control.machine import Machine
from ptzd.control.ranks import rank_mermaid
from ptzd.control.states import SERVING, TRANSITIONS, WORKING, ImpossibleEvent, State, mermaid, transition_arrows
from tests.control.plain_events import SECOND_NS, plain

KINDS = tuple(
    kind for kind in vars(ev).values() if isinstance(kind, type) and issubclass(kind, ev.Event) and kind is not ev.Event
)
README = Path(__file__).parents[2] / "README.md"


@pytest.fixture(scope="module")
def snapshots(new_world) -> dict[State, tuple[ev.Snapshot, int]]:
    """A core caught in each state, and the time then."""
    found: dict[State, tuple[ev.Snapshot, int]] = {}

    def keep(world) -> None:
        found[world.machine.state] = (world.machine.snapshot(), world.t_ns)

    world = new_world()
    keep(world)
    world.start()
    keep(world)
    world.silent = {cmd.RunMatch}
    world.request("a", hold_s=0.0)
    world.request("b", token=2, hold_s=0.0)
    keep(world)
    world.run(until=State.MATCH)
    keep(world)
    world.silent = set()
    world.run(until=State.LOCK)
    keep(world)
    world.run(until=State.HOME)
    keep(world)
    world.tell(ev.LeaseAsked(token=4, wish=ev.LeaseWish.TAKE, owner="desk"))
    world.run(until=State.MANUAL)
    keep(world)
    world.tell(ev.LeaseAsked(token=5, wish=ev.LeaseWish.GIVE, owner="desk"))
    world.tell(ev.GotoAsked(token=6, place="gate"))
    keep(world)
    world.tell(ev.PatrolAsked(token=7, wish=ev.PatrolWish.START, patrol="night"))
    world.run(until=State.PATROL)
    keep(world)
    world.request("c", token=3, hold_s=0.0)
    world.tell(ev.DeviceLost(device=ev.Device.FISHEYE, reason="unplugged"))
    keep(world)
    world.tell(ev.ShutdownRequested())
    keep(world)
    assert found.keys() == set(State)
    return found


@pytest.mark.parametrize(
    ("state", "kind"),
    list(itertools.product(State, KINDS)),
    ids=lambda value: value.__name__ if isinstance(value, type) else str(value),
)
def test_every_pair_ends_in_a_listed_state_or_changes_nothing(rig, config, snapshots, state, kind) -> None:
    snapshot, t_ns = snapshots[state]
    machine = Machine.restored(rig, config, snapshot)
    event = plain(kind, t_ns + SECOND_NS)
    listed = TRANSITIONS.get((state, kind))
    if listed is None:
        with pytest.raises(ImpossibleEvent, match=f"{kind.__name__} cannot happen in {state}"):
            machine.handle(event, t_ns + SECOND_NS)
        assert machine.snapshot().state == snapshot.state
    else:
        machine.handle(event, t_ns + SECOND_NS)
        assert machine.state in listed


def test_only_a_snapshot_is_impossible() -> None:
    impossible = {(state, kind) for state in State for kind in KINDS} - TRANSITIONS.keys()
    assert impossible == {(state, ev.Snapshot) for state in State}


def test_a_stopped_core_stays_stopped_and_nothing_moves() -> None:
    assert all(after == {State.STOPPED} for (state, _), after in TRANSITIONS.items() if state is State.STOPPED)
    into_work = {state for (state, _), after in TRANSITIONS.items() if after & WORKING}
    assert into_work == SERVING | {State.STARTING, State.FAULT}
    assert {kind for (state, kind), after in TRANSITIONS.items() if state is State.FAULT and after & SERVING} == {
        ev.DeviceWell
    }


def test_the_diagram_has_every_state_and_every_arrow() -> None:
    lines = mermaid().splitlines()
    assert all(any(state in line for line in lines) for state in State)
    drawn = {tuple(line.split(":")[0].split()) for line in lines if "-->" in line}
    everywhere = {State.FAULT, State.STOPPED}
    arrows = {(start, "-->", end) for start, end, _ in transition_arrows() if end not in everywhere}
    assert arrows <= drawn
    assert {line for line in drawn - arrows if "[*]" not in line} <= {("FAULT", "-->", "STOPPED")}


@pytest.mark.parametrize(("name", "drawn"), [("states", mermaid()), ("ranks", rank_mermaid())])
def test_the_diagrams_in_readme_are_what_the_code_says(name: str, drawn: str) -> None:
    shown = re.search(rf"<!-- {name} -->(.*)<!-- /{name} -->", README.read_text(), re.DOTALL)
    assert shown is not None, f"README.md marks the diagram with <!-- {name} --> … <!-- /{name} -->"
    assert shown.group(1).strip() == f"```mermaid\n{drawn}\n```", "renew it: ptzd states [--ranks]"
