from __future__ import annotations

import numpy as np
import pytest

from ptzd.calibration.guide import CELLS, STILL_S, Action, Goal, Guide, lit_cells

SIZE = (640, 480)
FIELD = np.ones((CELLS, CELLS), bool)


def board(x, y, tilt=0.0):
    """Points of a board of 120×90 px about a place; tilt narrows one side."""
    u, v = np.meshgrid(np.linspace(-60, 60, 5), np.linspace(-45, 45, 4))
    return np.stack([x + u * (1.0 + tilt * v / 90.0), y + v], axis=-1).reshape(-1, 2)


def shown(guide, start_s, pixels, for_s=2 * STILL_S):
    """The last word on a board that stands from a time on."""
    return [guide.look(start_s + t, pixels).action for t in np.arange(0.0, for_s, 0.1)]


def test_a_standing_board_is_taken_once():
    guide = Guide(SIZE, FIELD)
    actions = shown(guide, 0.0, board(320, 240))
    assert actions.count(Action.TAKE) == 1
    assert actions[0] is Action.MOVING
    assert shown(guide, 5.0, board(322, 241))[-1] is Action.KNOWN


def test_a_moving_board_is_not_taken():
    guide = Guide(SIZE, FIELD)
    assert all(guide.look(0.1 * k, board(200 + 5 * k, 240)).action is Action.MOVING for k in range(40))


def test_a_board_lost_for_a_moment_begins_to_stand_anew():
    guide = Guide(SIZE, FIELD)
    for k in range(30):
        wanted = None if k % 3 == 2 else board(320, 240)
        assert guide.look(0.1 * k, wanted).action in (Action.MOVING, Action.NO_BOARD)


def test_reversed_points_are_the_same_board():
    guide = Guide(SIZE, FIELD)
    shown(guide, 0.0, board(320, 240))
    assert Action.TAKE not in shown(guide, 5.0, board(320, 240)[::-1])


def test_enough_when_all_parts_are_covered_and_pictures_suffice():
    guide = Guide(SIZE, FIELD, Goal(pictures=12))
    taken, start_s = 0, 0.0
    for y in (60, 170, 300, 420):
        for x in (70, 195, 320, 445, 570):
            taken += shown(guide, start_s, board(x, y, 0.3)).count(Action.TAKE)
            start_s += 5.0
    assert guide.enough
    assert 12 <= taken <= 20
    assert guide.look(start_s, None).action is Action.ENOUGH


def test_advice_leads_to_the_part_without_a_board():
    guide = Guide(SIZE, FIELD)
    for y in (60, 170, 300, 420):
        for x in (195, 320, 445, 570):
            guide.keep(board(x, y))
    assert "left" in guide.look(0.0, None).text


def test_what_an_earlier_run_took_counts():
    guide = Guide(SIZE, FIELD)
    guide.keep(board(320, 240))
    assert guide.covered > 0.0
    assert Action.TAKE not in shown(guide, 0.0, board(320, 240))


@pytest.mark.parametrize(("radius_px", "corner"), [(230, False), (500, True)])
def test_black_corners_need_no_board(radius_px, corner):
    y, x = np.mgrid[:480, :640]
    grey = np.where(np.hypot(x - 320, y - 240) < radius_px, 120, 0).astype(np.uint8)
    field = lit_cells(grey)
    assert field[2, 2]
    assert field[0, 0] == corner
