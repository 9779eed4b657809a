"""What confirmed locks teach of a scene's ranges: learned, aged, taken back, and what is expected of a direction."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ptzd.control.planning.expected import ANYWHERE_SHARE
from ptzd.control.planning.ranges import HOUR_NS, MOST_LOCKS, NEAREST, RangeLock, RangeMap
from ptzd.geometry.arc import EpipolarArc

AHEAD = (0.0, 0.0, 1.0)
HALF_LIFE_H = 10.0


def towards(pan_deg: float, tilt_deg: float = 0.0) -> tuple[float, float, float]:
    pan, tilt = math.radians(pan_deg), math.radians(tilt_deg)
    return (math.sin(pan) * math.cos(tilt), -math.sin(tilt), math.cos(pan) * math.cos(tilt))


def lock(ray=AHEAD, s=0.2, t_h=0.0, name="a", sigma=0.002) -> RangeLock:
    return RangeLock(id=name, ray=ray, inverse_range=s, sigma=sigma, t_ns=round(t_h * HOUR_NS))


def of(*locks: RangeLock) -> RangeMap:
    made = RangeMap()
    for one in locks:
        made.learn(one)
    return made


def expected(learned: RangeMap, ray=AHEAD, t_h: float = 0.0):
    return learned.at(ray, round(t_h * HOUR_NS), half_life_h=HALF_LIFE_H, baseline=0.5)


def heaviest(learned: RangeMap, ray=AHEAD, t_h: float = 0.0):
    return max(expected(learned, ray, t_h).humps, key=lambda hump: hump.share)


rays = st.tuples(st.floats(-60, 60), st.floats(-40, 40)).map(lambda angles: towards(*angles))
locks = st.builds(lock, ray=rays, s=st.floats(0.0, 1.2), t_h=st.floats(0.0, 100.0), sigma=st.floats(1e-4, 0.05))
maps = st.lists(locks, min_size=1, max_size=25).map(lambda some: of(*some))


def test_nothing_is_expected_where_nothing_was_learned() -> None:
    assert expected(RangeMap()).humps == ()
    assert expected(of(lock(towards(80.0)))).humps == ()


def test_a_lock_teaches_its_direction_and_the_less_the_further_away() -> None:
    learned = of(lock(s=0.2))
    here, beside, further = (expected(learned, towards(pan)) for pan in (0.0, 6.0, 14.0))
    assert here.humps[0].mean == beside.humps[0].mean == 0.2
    assert here.known > beside.known > further.known > 0.0
    assert here.humps[0].sigma < beside.humps[0].sigma < further.humps[0].sigma


@given(height=st.floats(0.8, 4.0), pan=st.floats(-20, 20), tilt=st.floats(-35, -25))
def test_a_floor_goes_on_where_nobody_has_looked(height: float, pan: float, tilt: float) -> None:
    """The inverse range of a plane is linear in the ray: four locks on a floor tell it between them and beyond."""
    seen = [towards(*angles) for angles in ((-15, -40), (15, -42), (-12, -22), (14, -24), (2, -33))]
    learned = of(*(lock(ray, s=ray[1] / height) for ray in seen))
    ray = towards(pan, tilt)
    hump = heaviest(learned, ray)
    assert hump.mean == pytest.approx(ray[1] / height, rel=0.02)
    assert hump.sigma < 0.2 * hump.mean


def test_somebody_before_a_wall_is_one_of_two_surfaces() -> None:
    wall = [lock(towards(pan, tilt), s=0.1) for pan in (-6, 0, 6) for tilt in (-5, 4)]
    humps = expected(of(*wall, lock(s=0.5, name="walker"))).humps
    near = sum(hump.share for hump in humps if abs(hump.mean - 0.5) < 0.05)
    far = sum(hump.share for hump in humps if abs(hump.mean - 0.1) < 0.02)
    assert near > 0.05
    assert far > 0.05
    assert near + far == pytest.approx(sum(hump.share for hump in humps), abs=0.02)


@given(learned=maps, ray=rays, t_h=st.floats(0, 300))
def test_something_new_is_always_possible(learned: RangeMap, ray, t_h: float) -> None:
    there = expected(learned, ray, t_h)
    assert 0.0 <= there.known <= 1.0 - ANYWHERE_SHARE + 1e-9
    assert len(there.humps) <= NEAREST + 1
    assert all(hump.share >= 0.0 and hump.sigma > 0.0 and hump.mean >= 0.0 for hump in there.humps)


@given(learned=maps, ray=rays, t_h=st.floats(100, 200), later_h=st.floats(0.01, 100))
def test_what_was_learned_fades_and_never_grows(learned: RangeMap, ray, t_h: float, later_h: float) -> None:
    now, later = expected(learned, ray, t_h), expected(learned, ray, t_h + later_h)
    assert later.known <= now.known + 1e-12
    weights = learned.weights(round(t_h * HOUR_NS), HALF_LIFE_H)
    halved = learned.weights(round((t_h + HALF_LIFE_H) * HOUR_NS), HALF_LIFE_H)
    assert halved == pytest.approx(weights / 2.0, rel=1e-6)


def test_a_lock_of_a_later_time_counts_in_full_and_no_more() -> None:
    assert of(lock(t_h=50.0)).weights(0, HALF_LIFE_H).tolist() == [1.0]


def test_the_newer_surface_outweighs_the_older_one() -> None:
    assert heaviest(of(lock(s=0.1, t_h=0.0), lock(s=0.5, t_h=40.0)), t_h=40.0).mean == 0.5


@given(learned=maps, new=st.lists(locks, min_size=1, max_size=5))
def test_forgetting_the_newest_is_as_if_they_had_never_been(learned: RangeMap, new: list[RangeLock]) -> None:
    before = list(learned.locks)
    for one in new:
        learned.learn(one)
    assert learned.forget_last(len(new)) == new
    assert learned.locks == before


@given(learned=maps, ray=rays, radius_deg=st.floats(0.1, 40))
def test_forgetting_a_region_takes_what_lies_in_it_and_nothing_else(learned: RangeMap, ray, radius_deg: float) -> None:
    before = list(learned.locks)
    gone = learned.forget_where(lambda known: known @ np.array(ray) >= math.cos(math.radians(radius_deg)))
    assert sorted(map(repr, gone + learned.locks)) == sorted(map(repr, before))
    cosine = math.cos(math.radians(radius_deg))
    assert all(np.dot(one.ray, ray) >= cosine - 1e-9 for one in gone)
    assert all(np.dot(one.ray, ray) <= cosine + 1e-9 for one in learned.locks)


def test_forgetting_more_than_there_is_forgets_all() -> None:
    learned = of(lock(), lock(name="b"))
    assert [one.id for one in learned.forget_last(9)] == ["a", "b"]
    assert learned.locks == []


def test_it_does_not_grow_without_end_and_one_door_does_not_fill_it() -> None:
    elsewhere = [lock(towards(20.0 + 0.1 * k), name=f"w{k}") for k in range(10)]
    learned = of(*elsewhere, *(lock(name=f"d{k}") for k in range(MOST_LOCKS + 20)))
    assert len(learned.locks) == MOST_LOCKS
    assert [one.id for one in learned.locks[:10]] == [one.id for one in elsewhere]
    assert learned.locks[-1].id == f"d{MOST_LOCKS + 19}"


@given(learned=maps, cut=st.floats(0.1, 0.9), far=st.floats(0.0, 0.1), near=st.floats(0.3, 1.2))
def test_along_an_arc_all_is_somewhere(rig, learned: RangeMap, cut: float, far: float, near: float) -> None:
    arc = EpipolarArc.of(rig, AHEAD, far, near)
    there = expected(learned, t_h=100.0).along(arc)
    middle = far + cut * (near - far)
    assert there.mass(far, near) == pytest.approx(1.0)
    assert there.mass(far, middle) + there.mass(middle, near) == pytest.approx(1.0)
    assert there.mass(middle, middle) == 0.0
    assert there.density(middle) >= ANYWHERE_SHARE - 1e-9


@given(learned=maps)
def test_the_density_is_the_mass_per_angle(rig, learned: RangeMap) -> None:
    arc = EpipolarArc.of(rig, AHEAD, 0.01, 1.0)
    there = expected(learned, t_h=100.0).along(arc)
    first, last = arc.angle_at([0.01, 1.0])
    angles = np.linspace(first, last, 401)
    densities = [there.density(float(s)) for s in arc.inverse_range_at(angles)]
    mean = float(np.trapezoid(densities, angles) / (last - first))
    assert mean == pytest.approx(1.0, abs=0.05)


def test_a_hump_outside_the_range_that_is_asked_for_says_nothing(rig) -> None:
    arc = EpipolarArc.of(rig, AHEAD, 0.3, 1.0)
    there = expected(of(lock(s=0.05))).along(arc)
    assert there.likeliest() is None
    assert there.density(0.6) == pytest.approx(1.0, abs=1e-3)
