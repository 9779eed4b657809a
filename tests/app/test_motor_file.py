"""What the motors have gone, in its file: kept, damaged, on a disk that takes nothing."""

from __future__ import annotations

import json
import logging
from pathlib import Path

import pytest

from ptzd.app.kept import put_in_place
from ptzd.app.motor_file import MotorBook, read_travel
from ptzd.config import Motor
from ptzd.control.motor import Minute, Travel
from ptzd.runtime.clock import SteadyClock

GONE = Travel(pan_deg=12.5, tilt_deg=3.0, zoom_steps=400.0, moves=7, spared=2, minutes=[Minute(number=5, moves=7)])


class Log:
    def __init__(self) -> None:
        self.documents: list[tuple[str, dict[str, object]]] = []

    def document(self, topic: str, t_ns: int, document: dict[str, object]) -> None:
        del t_ns
        self.documents.append((topic, document))


def book(path: Path, travel: Travel) -> tuple[MotorBook, Log]:
    log = Log()
    return MotorBook(path, lambda: (travel, Motor(moves_per_hour=9)), log, SteadyClock()), log


async def test_it_comes_back_as_it_was_and_stands_in_the_log(tmp_path: Path) -> None:
    path = tmp_path / "new" / "motor.json"
    made, log = book(path, GONE)
    await made.keep()
    assert read_travel(path) == GONE
    (told,) = log.documents
    assert told[0] == "/motor"
    assert told[1]["pan_deg"] == 12.5
    assert told[1]["moves_per_hour"] == 9
    await made.keep()
    assert len(log.documents) == 1, "what has not changed is not told again"
    assert [file.name for file in path.parent.iterdir()] == ["motor.json"]


def test_where_there_is_none_it_begins(tmp_path: Path) -> None:
    assert read_travel(tmp_path / "motor.json") == Travel()


WHOLE = {"ptzd_motor": 1, "travel": {"pan_deg": 1.0}}


@pytest.mark.parametrize(
    "content",
    [
        b"", b"\0\0\0\0", b"{", b"[]", b"{}", b'{"ptzd_motor": 1}', json.dumps(WHOLE).encode()[:-4],
        json.dumps({**WHOLE, "ptzd_motor": 2}).encode(), json.dumps({**WHOLE, "more": 1}).encode(),
        b'{"ptzd_motor": 1, "travel": {"pan_deg": -3}}', b'{"ptzd_motor": 1, "travel": {"pan_deg": NaN}}',
        b'{"ptzd_motor": 1, "travel": {"pan_deg": 1e999}}', b'{"ptzd_motor": 1, "travel": {"moves": "many"}}',
        b'{"ptzd_motor": 1, "travel": {"minutes": [{"number": 4}, {"number": 3}]}}', b"\xff\xfe",
    ],
)  # fmt: skip
def test_a_damaged_one_is_named_put_aside_and_begins_anew(tmp_path: Path, caplog, content: bytes) -> None:
    path = tmp_path / "motor.json"
    path.write_bytes(content)
    with caplog.at_level(logging.WARNING):
        assert read_travel(path) == Travel()
    (line,) = caplog.messages
    assert str(path) in line
    assert "kept as motor.damaged" in line
    assert "\n" not in line
    assert (tmp_path / "motor.damaged").read_bytes() == content
    assert not path.exists()


async def test_a_disk_that_takes_nothing_is_told_once_and_tried_again(tmp_path: Path, caplog) -> None:
    blocked = tmp_path / "file"
    blocked.write_text("no folder")
    made, _ = book(blocked / "motor.json", GONE)
    with caplog.at_level(logging.WARNING):
        await made.keep()
        await made.keep()
    assert len(caplog.messages) == 1
    blocked.unlink()
    await made.keep()
    assert read_travel(blocked / "motor.json") == GONE


def test_who_reads_while_it_is_written_finds_a_whole_one(tmp_path: Path, monkeypatch) -> None:
    path = tmp_path / "motor.json"
    whole = json.dumps(WHOLE).encode()
    put_in_place(path, whole)

    def torn(_number: int) -> None:
        raise OSError(28, "no space left")

    monkeypatch.setattr("os.fsync", torn)
    with pytest.raises(OSError, match="no space"):
        put_in_place(path, whole + whole)
    assert read_travel(path).pan_deg == 1.0
