from __future__ import annotations

from ptzd.bus.results import MOST, KeptResults

S = 1_000_000_000


def test_kept_for_its_time_and_no_longer():
    kept = KeptResults(600.0)
    kept.put("a", b"1", 0)
    assert kept.get("a", 600 * S) == b"1"
    assert kept.get("a", 600 * S + 1) is None
    assert list(kept.all(700 * S)) == []


def test_a_later_result_takes_the_place():
    kept = KeptResults(10.0)
    kept.put("a", b"1", 0)
    kept.put("b", b"2", 5 * S)
    kept.put("a", b"3", 9 * S)
    assert list(kept.all(12 * S)) == [("b", b"2"), ("a", b"3")]
    assert list(kept.all(16 * S)) == [("a", b"3")]


def test_a_flood_is_bounded():
    kept = KeptResults(600.0)
    for index in range(MOST + 10):
        kept.put(str(index), b"x", index)
    assert kept.get("9", MOST) is None
    assert kept.get("10", MOST) == b"x"


def test_a_flood_of_refusals_pushes_out_no_result():
    kept = KeptResults(600.0)
    kept.put("served", b"locked", 0)
    for index in range(MOST + 10):
        kept.put(f"junk-{index}", b"rejected", index, refused=True)
    assert kept.get("served", MOST) == b"locked"
    assert kept.get("junk-9", MOST) is None
    assert kept.get("junk-10", MOST) == b"rejected"
    assert len(list(kept.all(MOST))) == MOST + 1
    assert list(kept.all(MOST))[-1] == ("served", b"locked"), "what was served counts as the newest"


def test_one_id_has_one_result_on_whichever_shelf():
    kept = KeptResults(600.0)
    kept.put("a", b"rejected", 0, refused=True)
    kept.put("a", b"locked", 1)
    assert list(kept.all(2)) == [("a", b"locked")]
    kept.put("a", b"rejected", 2, refused=True)
    assert kept.get("a", 3) == b"rejected"
    assert list(kept.all(700 * S)) == []
