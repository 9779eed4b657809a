"""What goes first when there is too much, and what never goes."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ptzd.config import LogSettings
from ptzd.log.retention import RESERVE_BYTES, Stored, closed_files, file_name, surplus

DAY = 86_400.0


def stored(sizes, now_s=100 * DAY, age_days=0.0):
    return [Stored(path=f"{index}", size=size, t_s=now_s - age_days * DAY + index) for index, size in enumerate(sizes)]


def limits(**changes):
    return LogSettings(**({"keep_bytes": 1_000_000, "keep_days": 30.0, "min_free_bytes": 0} | changes))


@given(st.lists(st.integers(0, 2_000_000), max_size=8), st.integers(0, 2_000_000), st.integers(0, 64 << 20))
def test_the_oldest_go_and_no_more_than_needed(sizes, open_bytes, free):
    files = stored(sizes)
    doomed = surplus(files, limits(), free=free, open_bytes=open_bytes, now_s=100 * DAY)
    assert doomed == files[: len(doomed)]

    def fits(gone):
        kept = open_bytes + sum(item.size for item in files[gone:])
        return kept <= 1_000_000 and free + sum(item.size for item in files[:gone]) >= RESERVE_BYTES

    assert fits(len(doomed)) or len(doomed) == len(files)
    assert not any(fits(fewer) for fewer in range(len(doomed)))


def test_old_files_go_by_age():
    files = [*stored([10], age_days=31), *stored([10], age_days=29)]
    assert surplus(files, limits(), free=1 << 40, open_bytes=0, now_s=100 * DAY) == files[:1]


def test_files_go_for_room():
    files = stored([1 << 20] * 4)
    gone = surplus(
        files, limits(keep_bytes=1 << 40, min_free_bytes=1 << 30), free=(1 << 30) - 1, open_bytes=0, now_s=0.0
    )
    assert gone == files[:1]


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
