"""What goes first when there is too much, and what never goes."""

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ptzd.config import LogSettings
from ptzd.log.retention import RESERVE_BYTES, Stored, closed_files, doubt, file_name, surplus

DAY = 86_400.0


def stored(sizes, now_s=100 * DAY, age_days=0.0):
    return [
        Stored(path=Path(f"{index}"), size=size, t_s=now_s - age_days * DAY + index) for index, size in enumerate(sizes)
    ]


def limits(**changes):
    return LogSettings(**({"keep_bytes": 1_000_000, "keep_days": 30.0, "min_free_bytes": 0} | changes))


@given(st.lists(st.integers(0, 2_000_000), max_size=8), st.integers(0, 2_000_000), st.integers(0, 64 << 20))
def test_the_oldest_go_and_no_more_than_needed(sizes, open_bytes, free):
    files = stored(sizes)
    doomed = surplus(files, limits(), free=free, open_bytes=open_bytes, now_s=100 * DAY)
    assert [gone.stored for gone in doomed] == files[: len(doomed)]

    def fits(gone):
        kept = open_bytes + sum(item.size for item in files[gone:])
        return kept <= 1_000_000 and free + sum(item.size for item in files[:gone]) >= RESERVE_BYTES

    assert fits(len(doomed)) or len(doomed) == len(files)
    assert not any(fits(fewer) for fewer in range(len(doomed)))


def test_old_files_go_by_age():
    files = [*stored([10], age_days=31), *stored([10], age_days=29)]
    assert surplus(files, limits(), free=1 << 40, open_bytes=0, now_s=100 * DAY) == []
    aged = [Stored(path=Path(f"{day}"), size=10, t_s=(100 - day) * DAY) for day in range(40, 0, -1)]
    gone = surplus(aged, limits(), free=1 << 40, open_bytes=0, now_s=100 * DAY)
    assert [item.stored for item in gone] == aged[:10]
    assert {item.reason for item in gone} == {"older than log.keep_days, 30"}


def test_files_go_for_room():
    files = stored([1 << 20] * 4)
    gone = surplus(
        files, limits(keep_bytes=1 << 40, min_free_bytes=1 << 30), free=(1 << 30) - 1, open_bytes=0, now_s=0.0
    )
    assert [item.stored for item in gone] == files[:1]
    assert "log.min_free_bytes" in gone[0].reason
    assert str(gone[0]).startswith("0 (1 MB) deleted: less than 1.1 GB is free")


def test_names_sort_by_time_and_then_by_number(tmp_path):
    second = 1_795_000_000_000_000_000
    names = [file_name("a-b", second, 2), file_name("a-b", second, 1000), file_name("a-b", second + 10**9, 0)]
    assert names[0] == "a-b-20261118T110640Z-002.mcap"
    for name in [*names, file_name("b", second, 0), "holiday.mcap", "a-b-20261118T110640Z-003.mcap.active"]:
        (tmp_path / name).write_bytes(b"x")
    assert [item.path.name for item in closed_files(tmp_path, "a-b")] == names
    assert closed_files(tmp_path, "c") == []


@pytest.mark.parametrize("rig", ["yard", "north-20261121T231502Z-000"])
def test_a_rig_sees_its_own_files_only(tmp_path, rig):
    (tmp_path / file_name(rig, 10**18, 0)).write_bytes(b"1234")
    (found,) = closed_files(tmp_path, rig)
    assert found.size == 4
    assert found.t_s == pytest.approx(found.path.stat().st_mtime)


def nights(days, *, hours=6.0):
    """Files of some days (counted back from day 100), every few hours."""
    steps = int(24 / hours)
    return [
        Stored(path=Path(f"{day}-{step}"), size=10, t_s=(100 - day) * DAY + step * hours * 3600)
        for day in sorted(days, reverse=True)
        for step in range(steps)
    ]


@given(st.floats(1.5, 4000.0), st.lists(st.integers(1, 60), min_size=1, max_size=20, unique=True))
def test_a_clock_that_leaps_ahead_deletes_nothing_by_age(leap_days, days):
    files = nights(days)
    now_s = files[-1].t_s + leap_days * DAY
    assert surplus(files, limits(), free=1 << 40, open_bytes=0, now_s=now_s) == []
    if leap_days > 30:
        assert "days after the newest file of the log" in (told := doubt(files, limits(), now_s))
        assert f"{len(files)} files stay" in told


@given(st.floats(0.1, 4000.0), st.integers(1, 20))
def test_a_clock_that_goes_back_deletes_nothing_by_age(back_days, count):
    files = nights(range(1, count + 1))
    now_s = files[-1].t_s - back_days * DAY
    assert surplus(files, limits(), free=1 << 40, open_bytes=0, now_s=now_s) == []
    assert "days before the newest file" in doubt(files, limits(), now_s)


def test_after_a_rig_was_off_for_weeks_old_files_go_when_the_clock_has_gone_on_for_a_day():
    files = nights(range(60, 50, -1))
    start_s = 100 * DAY
    fresh = [Stored(path=Path(f"new-{hour}"), size=10, t_s=start_s + hour * 3600) for hour in range(30)]
    for hours in range(30):
        gone = surplus(
            [*files, *fresh[: hours + 1]], limits(), free=1 << 40, open_bytes=0, now_s=start_s + hours * 3600 + 60
        )
        assert bool(gone) == (hours >= 24)
        assert all(item.stored in files for item in gone)


def test_what_a_link_leads_to_is_not_ours(tmp_path):
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    (elsewhere / "kept.mcap").write_bytes(b"precious")
    folder = tmp_path / "log"
    folder.mkdir()
    (folder / file_name("a", 10**18, 0)).symlink_to(elsewhere / "kept.mcap")
    assert closed_files(folder, "a") == []
