from __future__ import annotations

import math

import pytest

from ptzd import __version__
from ptzd.cli import entry
from ptzd.cli.parser import box, count, interval, parser
from ptzd.model import Box

COMMANDS = ("demo", "run", "check", "sim", "aim", "status", "watch", "stop", "home", "hold", "release", "ls", "cancel",
            "presets", "goto", "patrol", "home-after",
            "locate", "plan", "replay", "log", "schema", "states")  # fmt: skip


@pytest.mark.parametrize(
    "arguments",
    [
        [],
        ["fly"],
        ["run"],
        ["aim"],
        ["aim", "1,2,3"],
        ["aim", "1,2,3,x"],
        ["aim", "1,2,3,nan"],
        ["aim", "1,2,0,5"],
        ["aim", "1,2,8,8", "--range", "1"],
        ["aim", "1,2,8,8", "--priority", "high"],
        ["locate"],
        ["demo", "--boxes", "0"],
        ["demo", "--boxes", "two"],
        ["demo", "--nonsense"],
        ["sim", "--port", "http"],
        ["replay"],
        ["locate", "--calibration", "r", "--fisheye", "f", "--box", "1,2,8,8", "--views", "v", "--matcher", "magic"],
    ],
)
def test_a_usage_error_exits_with_64_and_says_so_on_stderr(arguments: list[str], capsys) -> None:
    with pytest.raises(SystemExit) as ended:
        entry(arguments)
    said = capsys.readouterr()
    assert ended.value.code == 64
    assert said.out == ""
    assert said.err.startswith("usage: ptzd")


def test_the_version(capsys) -> None:
    with pytest.raises(SystemExit) as ended:
        entry(["--version"])
    assert ended.value.code == 0
    assert capsys.readouterr().out == f"ptzd {__version__}\n"


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_has_its_help(command: str, capsys) -> None:
    with pytest.raises(SystemExit) as ended:
        entry([command, "--help"])
    assert ended.value.code == 0
    assert f"ptzd {command}" in capsys.readouterr().out


def test_boxes_intervals_and_counts() -> None:
    assert box("1,2.5,30,40") == Box(x=1, y=2.5, w=30, h=40)
    assert interval("1.5,inf") == (1.5, math.inf)
    assert count("12") == 12


def test_the_defaults_of_a_client() -> None:
    arguments = parser().parse_args(["aim", "1,2,30,40"])
    assert (arguments.connect, arguments.prefix, arguments.rig) == ("tcp/127.0.0.1:7447", "ptzd", None)
    assert (arguments.priority, arguments.label, arguments.frame, arguments.keep_zoom) == (0, "", None, False)
