"""`ptzd demo` as a person types it: simulator and daemon in processes of their own, over real sockets."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import pytest

from ptzd.cli import entry


@pytest.mark.parametrize("scene", ["room", "pair_hall"])
def test_the_demo_locks_its_boxes_and_leaves_a_log_that_replays(
    scene: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert entry(["demo", "--scene", scene, "--boxes", "3", "--out", str(tmp_path), "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert said["outcome"] == "locked"
    assert [request["outcome"] for request in said["requests"]] == ["locked"] * 3
    assert all(request["error_deg"] <= 0.5 for request in said["requests"])
    assert all(len(request["box"]) == 4 and request["elapsed_s"] > 0 for request in said["requests"])

    sheet = cv2.imread(said["sheet"])
    rows, columns = sheet.shape[:2]
    assert rows >= 3 * 200
    assert columns >= 4 * 300
    assert sheet.std() > 20

    for more in ([], ["--recompute"]):
        assert entry(["replay", said["log"], "--json", *more]) == 0
        report = json.loads(capsys.readouterr().out)
        assert report["same"]
        assert report["differences"] == []
        assert sorted(report["requests"].values()) == ["locked"] * 3
        assert bool(report["matches"]) == bool(more)
    assert not list(tmp_path.glob("log/*.active"))
