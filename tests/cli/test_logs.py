from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from ptzd.cli import entry

GOLDEN = Path(__file__).parents[1] / "golden"


@pytest.fixture
def log(tmp_path: Path) -> Path:
    return Path(shutil.copy(GOLDEN / "lock.mcap", tmp_path / "lock.mcap"))


def test_info_tells_each_request(log: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert entry(["log", "info", str(log)]) == 0
    assert "locked" in capsys.readouterr().out
    assert entry(["log", "info", "--json", str(log)]) == 0
    document = json.loads(capsys.readouterr().out)
    assert [request["outcome"] for request in document["requests"]] == ["locked"]


def test_a_torn_log_is_recovered_in_place(log: Path, capsys: pytest.CaptureFixture[str]) -> None:
    whole = log.read_bytes()
    log.write_bytes(whole[: len(whole) * 3 // 4])
    assert entry(["log", "recover", "--json", str(log)]) == 0
    assert json.loads(capsys.readouterr().out)["messages"] > 0
    assert entry(["log", "recover", str(log)]) == 0
    assert "whole" in capsys.readouterr().out


def test_export_writes_tables_and_a_page_per_request(log: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert entry(["log", "export", str(log), "--json", "--pictures"]) == 0
    facts = json.loads(capsys.readouterr().out)
    folder = Path(facts["directory"])
    assert facts["requests"] == 1
    assert facts["pictures"] > 1
    assert (folder / "requests.csv").read_text().count("\n") == 2
    assert list(folder.glob("**/*.html"))


def test_the_page_of_one_request_stands_alone(log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert entry(["log", "info", "--json", str(log)]) == 0
    name = json.loads(capsys.readouterr().out)["requests"][0]["id"]
    assert entry(["log", "export", str(log), "--request", name, "--out", str(tmp_path / "page.html")]) == 0
    page = Path(capsys.readouterr().out.strip()).read_text()
    assert "data:image/jpeg" in page
    assert 'src="http' not in page


def test_what_is_no_log_is_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "notes.mcap"
    path.write_text("not a log")
    assert entry(["log", "info", str(path)]) == 65
    assert len(capsys.readouterr().err.splitlines()) == 1
