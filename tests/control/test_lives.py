"""Random lives of the core: the laws hold, a twin decides the same, and the lives go everywhere."""

from __future__ import annotations

import random

import msgspec
from hypothesis import example, given, settings
from hypothesis import strategies as st

from ptzd.config_zones import HeadZone
from ptzd.control import commands as cmd
from ptzd.control.machine import Machine
from ptzd.control.planning.reach import reach_of
from ptzd.control.planning.zones import zones_of
from ptzd.control.states import State
from ptzd.model import Outcome, ZoneKind
from tests.control.conftest import World
from tests.control.lives import Life

LIKELY = ("request", "answer", "answer", "answer", "answer", "answer", "deadline")
UNLIKELY = (
    "well_ptz", "well_fisheye", "lost", "frame", "refused", "update", "cancel", "control", "head_fails", "match_fails",
    "late_answer", "polled", "foreign", "early_deadline", "wait", "start",
    "settings", "ranges", "lease", "lease", "lease", "hand", "hand", "hand", "polled", "lens_answers",
    "goto", "goto", "patrol", "patrol", "patrol", "due", "home_after",
)  # fmt: skip
ACTIONS = [*LIKELY * 8, *UNLIKELY]


@settings(max_examples=120)
@example(seed=643)
@example(seed=310)
@example(seed=31007)
@given(seed=st.integers(0, 2**32 - 1))
def test_a_life_of_whatever_may_come(rig, config, new_world, seed: int) -> None:
    chance = random.Random(seed)
    life = Life(new_world(), chance)
    life.act("start")
    for action in chance.choices(ACTIONS, k=chance.randint(5, 60)):
        life.act(action)
    middle, told, done = life.machine.snapshot(), len(life.told), len(life.done)
    in_force = life.machine.config
    for action in chance.choices(ACTIONS, k=chance.randint(5, 60)):
        life.act(action)
    life.end()
    twin, heir = Machine(rig, config), Machine.restored(rig, in_force, middle)
    assert [command for event, t_ns in life.told for command in twin.handle(event, t_ns)] == life.done
    assert [command for event, t_ns in life.told[told:] for command in heir.handle(event, t_ns)] == life.done[done:]
    for action in chance.choices(ACTIONS, k=5):
        life.act(action)
    assert life.machine.state is State.STOPPED


ZONES = tuple(
    HeadZone(name=name, kind=kind, corners_deg=corners, range_m=(1e3, 1e4))
    for name, kind, corners in (
        ("lamp", ZoneKind.NO_GO, ((-20.0, -6.0), (-10.0, -6.0), (-10.0, 6.0), (-20.0, 6.0))),
        ("wall", ZoneKind.NO_GO, ((30.0, -60.0), (36.0, -60.0), (36.0, 60.0), (30.0, 60.0))),
        ("window", ZoneKind.PRIVACY, ((8.0, 4.0), (14.0, 4.0), (14.0, 9.0), (8.0, 9.0))),
    )
)


@settings(max_examples=60)
@given(seed=st.integers(0, 2**32 - 1))
def test_a_life_among_zones(rig, config, seed: int) -> None:
    """The laws hold as before, the twin decides the same, no set point is in a no-go zone or sees a window."""
    chance = random.Random(seed)
    life = Life(World(rig, msgspec.structs.replace(config, zones=ZONES)), chance)
    life.act("start")
    for action in chance.choices(ACTIONS, k=chance.randint(5, 80)):
        life.act(action)
    in_force, middle, told, done = life.machine.config, life.machine.snapshot(), len(life.told), len(life.done)
    for action in chance.choices(ACTIONS, k=20):
        life.act(action)
    life.end()
    twin = Machine(rig, msgspec.structs.replace(config, zones=ZONES))
    heir = Machine.restored(rig, in_force, middle)
    assert [command for event, t_ns in life.told for command in twin.handle(event, t_ns)] == life.done
    assert [command for event, t_ns in life.told[told:] for command in heir.handle(event, t_ns)] == life.done[done:]
    reach = reach_of(life.limits, rig, zones_of(in_force, rig))
    target = None
    for command in life.done:
        if isinstance(command, cmd.MoveHead):
            target = command.target
            assert "no_go" not in (reach.objection(target) or "")
        if isinstance(command, cmd.GrabView) and target is not None:
            assert reach.contains(target), "a picture is taken only where the head may rest"


RARE = {Outcome.LOST, Outcome.RELEASED, Outcome.AMBIGUOUS, Outcome.SHADOW}
"""Ends that only a certain course of events leads to; tests of the core lead there."""


def test_such_lives_go_everywhere(new_world) -> None:
    """The test above would prove nothing if its events led nowhere."""
    seen: set[str] = set()
    for seed in range(60):
        chance = random.Random(seed)
        life = Life(new_world(), chance)
        life.act("start")
        for action in chance.choices(ACTIONS, k=100):
            life.act(action)
            seen.add(life.machine.state)
        seen |= {command.outcome for command in life.done if isinstance(command, cmd.PublishResult)}
    assert seen >= (set(State) - {State.STOPPED, State.STARTING}) | set(Outcome) - RARE
