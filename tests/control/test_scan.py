"""The walk along the arc, and when it is over."""

from __future__ import annotations

import math

import msgspec
import pytest

from ptzd.control import commands as cmd
from ptzd.control.states import State


@pytest.mark.parametrize("certain", [True, False])
def test_only_a_certain_answer_ends_a_scan_early(make_world, config, certain: bool) -> None:
    search = msgspec.structs.replace(config.search, certain_probability=0.5 if certain else 1.0)
    world = make_world(search=search)
    world.start()
    world.request("a", range_m=(0.6, math.inf), hold_s=0.0)
    planned = next(step.detail["views"] for step in world.of(cmd.PublishFeedback) if step.step == "plan")
    world.run(until=State.LOCK)
    assert planned > 1
    assert len(world.of(cmd.RunMatch)) < planned if certain else len(world.of(cmd.RunMatch)) >= planned
