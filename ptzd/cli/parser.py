"""All arguments of all commands."""

from __future__ import annotations

import argparse
import math
import sys
from pathlib import Path
from typing import NoReturn

from ptzd import __version__
from ptzd.cli import asking, by_hand, calibrate, known_ranges, offline, places, replaying, rig
from ptzd.model import Box, Matcher

EX_USAGE = 64
_RANGE = "nearest and farthest range; m, or baselines where the rig has no scale (metric: false)"


class _Parser(argparse.ArgumentParser):
    """Usage errors exit with 64, as sysexits.h says."""

    def error(self, message: str) -> NoReturn:
        self.print_usage(sys.stderr)
        self.exit(EX_USAGE, f"{self.prog}: {message}\n")


def parser() -> argparse.ArgumentParser:
    """Build the parser; every command sets ``run``, a function of the parsed arguments that returns the exit code."""
    top = _Parser(prog="ptzd", description="Points an AXIS PTZ camera at what a fisheye camera sees.")
    top.add_argument("--version", action="version", version=f"ptzd {__version__}")
    top.add_argument("--debug", action="store_true", help="show the traceback of an error")
    commands = top.add_subparsers(dest="command", required=True, metavar="COMMAND", parser_class=_Parser)
    _add_rig_commands(commands)
    _add_bus_commands(commands)
    _add_offline_commands(commands)
    calibrate.add_commands(commands)
    return top


def _numbers(text: str, count: int) -> list[float]:
    try:
        values = [float(part) for part in text.split(",")]
    except ValueError:
        values = []
    if len(values) != count or any(math.isnan(value) for value in values):
        raise argparse.ArgumentTypeError(f"expected {count} numbers separated by commas, got {text!r}")
    return values


def box(text: str) -> Box:
    """Parse ``X,Y,W,H``."""
    x, y, w, h = _numbers(text, 4)
    try:
        return Box(x=x, y=y, w=w, h=h)
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from None


def interval(text: str) -> tuple[float, float]:
    """Parse ``MIN,MAX``; MAX may be ``inf``."""
    low, high = _numbers(text, 2)
    return low, high


def quiet(text: str) -> float | str:
    """Parse seconds, ``never`` or ``settings``."""
    if text in {"never", "settings"}:
        return text
    try:
        return float(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"expected seconds, never or settings, got {text!r}") from None


def count(text: str) -> int:
    """Parse a whole number of at least 1."""
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"expected a whole number of at least 1, got {text!r}")
    return int(text)


def _add_rig_commands(commands: argparse._SubParsersAction[_Parser]) -> None:
    demo = commands.add_parser("demo", help="a simulated rig, the real daemon, several boxes, a picture of it all")
    demo.add_argument("--scene", default="room", help="name of a scene: see `ptzd sim --list`")
    demo.add_argument("--out", type=Path, default=Path("demo"), help="folder for log and sheet")
    demo.add_argument("--boxes", type=count, default=4, metavar="N", help="how many of the scene's boxes (default 4)")
    demo.add_argument("--json", action="store_true")
    demo.set_defaults(run=rig.demo)
    run = commands.add_parser("run", help="the daemon")
    run.add_argument("--config", type=Path, required=True)
    run.add_argument("--shadow", action="store_true", help="decide and log everything, move nothing")
    run.set_defaults(run=rig.run)
    check = commands.add_parser("check", help="settings and calibration; with --connect both cameras too")
    check.add_argument("--config", type=Path, required=True)
    check.add_argument("--connect", action="store_true", help="talk to both cameras and report what they are")
    check.add_argument("--timing", action="store_true", help="measure the delay of pictures by a few small steps too")
    check.add_argument("--zones", type=Path, metavar="FILE", help="draw the zones into a picture (PNG or JPEG)")
    check.add_argument("--picture", type=Path, metavar="JPEG", help="of the fisheye, to draw the zones over")
    check.set_defaults(run=rig.check)
    presets = commands.add_parser("presets", help="the camera's own presets as places of presets.yaml")
    presets.add_argument("--config", type=Path, required=True)
    presets.add_argument("--out", type=Path, metavar="FILE", help="a new file; default: print them")
    presets.set_defaults(run=rig.presets)
    sim = commands.add_parser("sim", help="the simulated rig alone")
    sim.add_argument("--list", action="store_true", help="names of scenes and profiles")
    sim.add_argument("--scene", default="room")
    sim.add_argument("--profile", default="v5915")
    sim.add_argument("--port", type=int, default=8080, help="of the AXIS camera")
    sim.add_argument("--fisheye-port", type=int, default=8081)
    sim.add_argument("--truth-port", type=int, default=8082)
    sim.add_argument("--user", default="ptzd")
    sim.add_argument("--password-file", type=Path, help="one line; default: pan-tilt-zoom")
    sim.add_argument("--faults", type=Path, help="a script of faults (YAML)")
    sim.add_argument("--write-config", type=Path, help="write settings and calibration for this rig into a folder")
    sim.add_argument("--bus", default="tcp/127.0.0.1:7447", help="Zenoh endpoint in the written settings")
    sim.add_argument("--json", action="store_true", help="say what is ready as one JSON line")
    sim.set_defaults(run=rig.sim)
    install = commands.add_parser("install-service", help="make this installation a systemd service (as root)")
    install.set_defaults(run=rig.install_service)


def _add_bus_commands(commands: argparse._SubParsersAction[_Parser]) -> None:
    common = _Parser(add_help=False)
    common.add_argument("--connect", default="tcp/127.0.0.1:7447", help="Zenoh endpoint of the daemon or a router")
    common.add_argument("--rig", help="name of the rig; not needed while only one is alive")
    common.add_argument("--prefix", default="ptzd")
    common.add_argument("--bus-config", help="JSON5 file with certificates")
    common.add_argument("--json", action="store_true")
    aim = commands.add_parser("aim", parents=[common], help="ask the rig to look at a box of the fisheye picture")
    aim.add_argument("box", type=box, metavar="X,Y,W,H")
    aim.add_argument("--id")
    aim.add_argument("--frame", type=int, metavar="SEQ", help="fisheye frame that the box was drawn on")
    aim.add_argument("--range", type=interval, metavar="MIN,MAX", help=_RANGE)
    aim.add_argument("--hfov", type=float, metavar="DEG")
    aim.add_argument("--keep-zoom", action="store_true")
    aim.add_argument("--fill", type=float)
    aim.add_argument("--hold", type=float, metavar="S")
    aim.add_argument("--timeout", type=float, metavar="S")
    aim.add_argument("--priority", type=int, default=0)
    aim.add_argument("--label", default="")
    aim.add_argument("--by", default="", metavar="OWNER", help="who asks; whoever has the lease is served under it")
    aim.set_defaults(run=asking.aim)
    for name, text, function in (
        ("status", "what the rig does now", asking.status),
        ("watch", "everything the rig says, until interrupted", asking.watch),
        ("stop", "stop the head at once and end every request", asking.control),
        ("home", "end every request and go home", asking.control),
        ("hold", "keep the present lock until release", asking.control),
        ("release", "end the held lock", asking.control),
        ("ls", "rigs alive", asking.ls),
    ):
        command = commands.add_parser(name, parents=[common], help=text)
        command.set_defaults(run=function)
    lease = commands.add_parser("lease", parents=[common], help="have the head for yourself until interrupted")
    lease.add_argument("owner", help="who you are")
    lease.add_argument("--for", type=float, dest="for_s", metavar="S", help="at most so long")
    lease.add_argument("--rank", type=int, default=0, help="0 to 8; a higher one takes the head from a lower one")
    lease.add_argument("--ask", action="store_true", help="only let whoever has it know that you want it")
    lease.set_defaults(run=asking.lease)
    move = commands.add_parser("move", parents=[common], help="move the head by hand, for whoever has the lease")
    move.add_argument("owner", help="who has it (`ptzd lease OWNER`, in another terminal)")
    way = move.add_mutually_exclusive_group(required=True)
    way.add_argument("--to", type=float, nargs=2, metavar=("PAN", "TILT"), help="to these angles, deg, as in `pose`")
    way.add_argument("--by", type=float, nargs=2, metavar=("PAN", "TILT"), help="by so much, deg; 0 0 zooms alone")
    way.add_argument("--point", type=float, nargs=2, metavar=("X", "Y"), help="centre this pixel of the PTZ's picture")
    way.add_argument("--frame", type=box, metavar="X,Y,W,H", help="and zoom until this rectangle fills it")
    way.add_argument("--speed", type=float, nargs=3, metavar=("PAN", "TILT", "ZOOM"), help="deg/s, and -1 to 1")
    way.add_argument("--focus", metavar="auto|UNITS", help="the camera's own units, until the end of the lease")
    way.add_argument("--iris", metavar="auto|UNITS")
    move.add_argument("--for", type=float, dest="for_s", metavar="S", help="how long to keep the speed; else 1 s")
    move.add_argument("--hfov", type=float, metavar="DEG", help="zoom until the picture is so wide")
    move.set_defaults(run=by_hand.move)
    _add_place_commands(commands, common)


def _add_place_commands(commands: argparse._SubParsersAction[_Parser], common: _Parser) -> None:
    goto = commands.add_parser("goto", parents=[common], help="send the head to a named place of presets.yaml")
    goto.add_argument("place")
    goto.add_argument("--hold", type=float, metavar="S", help="stay there so long before what waits goes on")
    goto.add_argument("--by", default="", metavar="OWNER", help="who asks; with a lease its owner alone may")
    goto.set_defaults(run=places.goto)
    patrol = commands.add_parser("patrol", parents=[common], help="from place to place, behind all else")
    patrol.add_argument("wish", choices=("start", "pause", "resume", "stop"))
    patrol.add_argument("patrol", nargs="?", default="", help="its name in presets.yaml; needed to start it")
    patrol.set_defaults(run=places.patrol)
    home_after = commands.add_parser("home-after", parents=[common], help="how long the head is left where it is")
    home_after.add_argument("after", type=quiet, metavar="S|never|settings", help="settings: as home.idle_s says")
    home_after.set_defaults(run=places.home_after)
    _add_ranges(commands, common)
    cancel = commands.add_parser("cancel", parents=[common], help="take a request back")
    cancel.add_argument("id")
    cancel.set_defaults(run=asking.cancel)


def _add_ranges(commands: argparse._SubParsersAction[_Parser], common: _Parser) -> None:
    ranges = commands.add_parser("ranges", parents=[common], help="what locks have taught of how far away things are")
    what = ranges.add_mutually_exclusive_group()
    what.add_argument("--forget-last", type=count, metavar="N", help="what the newest N locks have taught")
    what.add_argument("--forget-box", type=box, metavar="X,Y,W,H", help="what lies in a box of the fisheye picture")
    what.add_argument("--forget-all", action="store_true")
    ranges.set_defaults(run=known_ranges.ranges)


def _add_offline_commands(commands: argparse._SubParsersAction[_Parser]) -> None:
    locate = commands.add_parser("locate", help="the matching step on files")
    locate.add_argument("--calibration", type=Path, required=True)
    locate.add_argument("--fisheye", type=Path, required=True)
    locate.add_argument("--box", type=box, required=True, metavar="X,Y,W,H")
    locate.add_argument("--views", type=Path, required=True, metavar="VIEWS.json")
    locate.add_argument("--matcher", type=Matcher, choices=list(Matcher), default=Matcher.SWEEP)
    locate.add_argument("--range", type=interval, default=(1.0, 100.0), metavar="MIN,MAX", help=_RANGE)
    locate.add_argument("--json", action="store_true")
    locate.add_argument("--draw", type=Path, metavar="OUT.png")
    locate.set_defaults(run=offline.locate)
    plan = commands.add_parser("plan", help="the scan plan of a box")
    plan.add_argument("--calibration", type=Path, required=True)
    plan.add_argument("--box", type=box, required=True, metavar="X,Y,W,H")
    plan.add_argument("--zoom", type=float, required=True)
    plan.add_argument("--range", type=interval, default=(1.0, 100.0), metavar="MIN,MAX", help=_RANGE)
    plan.add_argument("--config", type=Path, help="settings whose limits the head is to keep (default: none)")
    plan.add_argument("--json", action="store_true")
    plan.set_defaults(run=offline.plan)
    replay = commands.add_parser("replay", help="run the same decisions again from a log")
    replay.add_argument("log", type=Path, help="a file, or a folder of files")
    replay.add_argument("--recompute", action="store_true", help="run every match again on the recorded pictures")
    replay.add_argument("--config", type=Path, help="what if: other settings")
    replay.add_argument("--calibration", type=Path, help="what if: another calibration")
    replay.add_argument(
        "--junit", type=Path, metavar="FILE", help="write a test report: a suite per file, a case per request"
    )
    replay.add_argument("--json", action="store_true")
    replay.set_defaults(run=replaying.replay)
    _add_log_commands(commands.add_parser("log", help="contents of a log, repair, tables and pictures out"))
    schema = commands.add_parser("schema", help="JSON Schema of the bus messages")
    schema.add_argument("type", nargs="?")
    schema.set_defaults(run=offline.schema)
    states = commands.add_parser("states", help="the state diagram, as Mermaid")
    states.add_argument("--ranks", action="store_true", help="who goes before whom instead")
    states.set_defaults(run=offline.states)


def _add_log_commands(log: argparse.ArgumentParser) -> None:
    actions = log.add_subparsers(dest="action", required=True, metavar="ACTION")
    common = _Parser(add_help=False)
    common.add_argument("file", type=Path)
    common.add_argument("--json", action="store_true")
    info = actions.add_parser("info", parents=[common], help="what a file holds, told per request")
    info.set_defaults(run=offline.log_info)
    recover = actions.add_parser("recover", parents=[common], help="repair a torn file in place")
    recover.set_defaults(run=offline.log_recover)
    export = actions.add_parser("export", parents=[common], help="CSV tables and a page per request")
    export.add_argument("--out", type=Path, help="folder; default: the log's name without .mcap")
    export.add_argument("--request", help="only the evidence page of this request")
    export.add_argument("--pictures", action="store_true", help="all pictures too, as sent and with overlays")
    export.set_defaults(run=offline.log_export)
