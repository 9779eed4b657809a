"""What locks have taught of the scene's ranges survives a restart, whatever happens to file, clock and calibration."""

import json
import logging
import math
from pathlib import Path

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ptzd.app.ranges_file import RangesBook, digest_of, ranges_path, read_ranges
from ptzd.config import Config, FilesSource, LogSettings, Ptz, Ranges
from ptzd.control.planning.ranges import HOUR_NS, RangeLock

DIGEST = digest_of("a calibration")
T_NS = 1_800_000_000_000_000_000


def lock(name: str = "a", age_h: float = 1.0) -> RangeLock:
    ray, t_ns = (0.0, math.sin(0.3), math.cos(0.3)), T_NS - round(age_h * HOUR_NS)
    return RangeLock(id=name, ray=ray, inverse_range=1 / 3, sigma=0.001, t_ns=t_ns)


@pytest.fixture
def config(tmp_path: Path) -> Config:
    return settings(tmp_path)


def settings(folder: Path) -> Config:
    return Config(
        rig="hall",
        calibration="rig.yaml",
        fisheye=FilesSource(path="pictures"),
        ptz=Ptz(url="http://127.0.0.1:1", user="operator"),
        log=LogSettings(directory=str(folder / "log")),
        ranges=Ranges(half_life_h=10.0),
    )


async def kept(config: Config, locks: list[RangeLock], digest: str = DIGEST, t_ns: int = T_NS) -> Path:
    known: list[RangeLock] = []
    book = RangesBook(ranges_path(config, digest), digest, lambda: known, lambda: t_ns)
    known += locks
    await book.keep()
    return ranges_path(config, digest)


async def test_it_is_there_again_after_a_restart(config: Config) -> None:
    locks = [lock("a"), lock("b", 0.25)]
    path = await kept(config, locks)
    assert read_ranges(config, DIGEST, T_NS).locks == locks
    assert [file.name for file in path.parent.iterdir()] == [path.name]


def test_without_a_file_nothing_is_known(config: Config) -> None:
    assert read_ranges(config, DIGEST, T_NS).locks == []


@pytest.mark.parametrize(
    ("away_h", "counted_h"), [(0.0, 0.0), (3.0, 3.0), (10.0, 10.0), (5e5, 10.0), (-5e5, 0.0), (-0.01, 0.0)]
)
async def test_a_clock_that_leapt_empties_no_map(config: Config, caplog, away_h: float, counted_h: float) -> None:
    caplog.set_level(logging.WARNING)
    await kept(config, [lock(age_h=1.0)])
    now_ns = T_NS + round(away_h * HOUR_NS)
    known = read_ranges(config, DIGEST, now_ns)
    (weight,) = known.weights(now_ns, 10.0)
    assert weight == pytest.approx(2 ** (-(1.0 + counted_h) / 10.0))
    assert bool(caplog.records) == (abs(away_h - counted_h) > 0.1)


async def test_another_calibration_has_a_map_of_its_own(config: Config, caplog) -> None:
    caplog.set_level(logging.INFO)
    path = await kept(config, [lock()])
    assert read_ranges(config, digest_of("another"), T_NS).locks == []
    assert f"another calibration are not used: {path.name}" in caplog.text
    await kept(config, [lock("other")], digest_of("another"))
    assert [known.id for known in read_ranges(config, DIGEST, T_NS).locks] == ["a"]


async def test_another_rig_beside_the_same_log_has_its_own(config: Config) -> None:
    await kept(config, [lock()])
    assert read_ranges(msgspec.structs.replace(config, rig="yard"), DIGEST, T_NS).locks == []


def spoilt(document: dict, **changes: object) -> bytes:
    return json.dumps(document | changes).encode()


DAMAGES = {
    "empty": lambda whole: b"",
    "torn": lambda whole: json.dumps(whole).encode()[:-40],
    "no text": lambda whole: b"\x00\xff\xfe" * 50,
    "another version": lambda whole: spoilt(whole, ptzd_ranges=2),
    "more in it": lambda whole: spoilt(whole, more=1),
    "of another calibration": lambda whole: spoilt(whole, calibration_sha256="0" * 64),
    "a ray of no length": lambda whole: spoilt(whole, locks=[whole["locks"][0] | {"ray": [0.0, 0.0, 0.0]}]),
    "not a number": lambda whole: json.dumps(whole).replace("0.001", "NaN").encode(),
    "behind the camera": lambda whole: spoilt(whole, locks=[whole["locks"][0] | {"inverse_range": -0.1}]),
    "no sigma": lambda whole: spoilt(whole, locks=[whole["locks"][0] | {"sigma": 0.0}]),
    "too many": lambda whole: spoilt(whole, locks=whole["locks"] * 600),
    "a list": lambda whole: b"[]",
}


@pytest.mark.parametrize("damage", DAMAGES)
async def test_a_damaged_file_is_put_aside_and_named(config: Config, caplog, damage: str) -> None:
    path = await kept(config, [lock()])
    content = DAMAGES[damage](json.loads(path.read_text()))
    path.write_bytes(content)
    assert read_ranges(config, DIGEST, T_NS).locks == []
    (record,) = caplog.records
    assert str(path) in record.getMessage()
    assert "\n" not in record.getMessage()
    assert path.with_suffix(".damaged").read_bytes() == content
    await kept(config, [lock("new")])
    assert [known.id for known in read_ranges(config, DIGEST, T_NS).locks] == ["new"]


async def test_a_folder_in_its_place_ends_nothing(config: Config, caplog) -> None:
    path = ranges_path(config, DIGEST)
    path.mkdir(parents=True)
    assert read_ranges(config, DIGEST, T_NS).locks == []
    assert str(path) in caplog.text


async def test_a_disk_that_takes_nothing_is_told_once_and_tried_again(config: Config, tmp_path: Path, caplog) -> None:
    known = [lock()]
    (tmp_path / "log").write_text("a file where the folder should be")
    path = ranges_path(config, DIGEST)
    book = RangesBook(path, DIGEST, lambda: known, lambda: T_NS)
    known.append(lock("b"))
    for _ in range(3):
        await book.keep()
    assert len(caplog.records) == 1
    assert str(path) in caplog.text
    (tmp_path / "log").unlink()
    await book.keep()
    assert [one.id for one in read_ranges(config, DIGEST, T_NS).locks] == ["a", "b"]


async def test_what_did_not_change_is_not_written(config: Config) -> None:
    path = ranges_path(config, DIGEST)
    await RangesBook(path, DIGEST, lambda: [lock()], lambda: T_NS).keep()
    assert not path.exists()


@given(s=st.floats(0.0, 2.0), sigma=st.floats(1e-6, 1.0), angle=st.floats(-3.0, 3.0))
def test_every_number_comes_back_to_the_bit(tmp_path_factory, s: float, sigma: float, angle: float) -> None:
    import asyncio

    config = settings(tmp_path_factory.mktemp("ranges"))
    one = RangeLock(id="a", ray=(math.sin(angle), 0.0, math.cos(angle)), inverse_range=s, sigma=sigma, t_ns=T_NS)
    asyncio.run(kept(config, [one]))
    assert read_ranges(config, DIGEST, T_NS).locks == [one]
