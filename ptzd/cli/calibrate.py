"""`ptzd calibrate`: pictures in, rig.yaml and a report out."""

from __future__ import annotations

import argparse
import asyncio
import json
import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn

from ptzd.calibration.target import Target, TargetKind, parse_target
from ptzd.cli import terminal
from ptzd.errors import CalibrationError
from ptzd.plain import plain, plain_lines

if TYPE_CHECKING:
    from ptzd.calibrate.parts import Outcome
    from ptzd.calibration.guide import Advice

_WORK = Path("calibration")


def add_commands(commands: argparse._SubParsersAction[Any]) -> None:
    """Add ``calibrate`` with its steps."""
    top = commands.add_parser("calibrate", help="from pictures or the live cameras to rig.yaml")
    steps = top.add_subparsers(dest="step", required=True, metavar="STEP", parser_class=type(top))
    common = argparse.ArgumentParser(add_help=False)
    common.add_argument("--work", type=Path, default=_WORK, help="folder that keeps pictures and parts")
    common.add_argument("--json", action="store_true")
    board = argparse.ArgumentParser(add_help=False)
    board.add_argument("--board", metavar="COLUMNSxROWS", help="inner corners, or circles; without it: from the scene")
    board.add_argument("--pitch", type=float, default=0.03, metavar="M", help="side of a square; m")
    board.add_argument("--kind", choices=[kind.value for kind in TargetKind], default=TargetKind.CHESSBOARD.value)
    board.add_argument("--dictionary", default="DICT_4X4_50", help="of a ChArUco board")

    capture = steps.add_parser("capture", parents=[common], help="drive the camera and keep pictures of the scene")
    capture.add_argument("--config", type=Path, required=True)
    capture.add_argument("--zooms", help="zoom units, separated by commas")
    capture.add_argument("--pan", help="LOW,HIGH, deg: where the head looks into the fisheye's view; else home ± 84")
    capture.add_argument("--tele", help="PAN,TILT, deg, of the tele pictures; else where most texture is")
    capture.set_defaults(run=_capture)
    draw = steps.add_parser("simulate", parents=[common], help="draw the pictures of a simulated rig")
    draw.add_argument("--scene", default="room")
    draw.add_argument("--profile", default="dome")
    draw.add_argument("--seed", type=int, default=3)
    draw.add_argument("--boards", action="store_true", help="with boards; without: the scene alone")
    draw.set_defaults(run=_simulate)
    _add_fisheye(steps, [common, board])
    _add_ptz(steps, [common, board])
    rig = steps.add_parser("rig", parents=[common, board], help="how both stand to each other; writes rig.yaml")
    rig.add_argument("shots", type=Path, help="list of PTZ pictures with their angles (JSON)")
    rig.add_argument("--fisheye", type=Path, help="the fisheye's picture, without a board")
    rig.add_argument("--out", type=Path, default=Path("rig.yaml"))
    rig.add_argument("--report", type=Path, help="HTML")
    limit = "pointing error at 95 % above which nothing is written, without a board; deg"
    rig.add_argument("--limit", type=_positive, default=0.2, metavar="DEG", help=limit)
    rig.add_argument("--accept", action="store_true", help="write rig.yaml whatever the verdict says")
    rig.set_defaults(run=_rig)
    verify = steps.add_parser("verify", parents=[common, board], help="measure the error with fresh pictures")
    verify.add_argument("shots", type=Path, help="list of PTZ pictures with their angles (JSON)")
    verify.add_argument("--calibration", type=Path, required=True)
    verify.add_argument("--fisheye", type=Path, help="the fisheye's picture, without a board")
    verify.add_argument("--truth", metavar="URL", help="side channel of a simulated rig: the true pointing error")
    verify.set_defaults(run=_verify)
    drift = steps.add_parser("drift", parents=[common], help="what the locks in logs say; refine R on request")
    drift.add_argument("logs", type=Path, nargs="*", help="MCAP files, oldest first")
    drift.add_argument("--calibration", type=Path, help="that was in use")
    drift.add_argument("--out", type=Path, help="write the rig turned back onto the locks")
    drift.add_argument("--undo", action="store_true", help="take back what the daemon refined; needs --config")
    drift.add_argument("--config", type=Path, help="settings of the daemon, with --undo")
    drift.set_defaults(run=_drift)


def _add_fisheye(steps: argparse._SubParsersAction[Any], parents: list[argparse.ArgumentParser]) -> None:
    fisheye = steps.add_parser("fisheye", parents=parents, help="the fisheye's lens")
    fisheye.add_argument("pictures", type=Path, nargs="?", help="folder with pictures of the board")
    fisheye.add_argument("--live", action="store_true", help="take the pictures now, guided; the folder keeps them")
    fisheye.add_argument("--config", type=Path, help="settings that name the fisheye, with --live")
    fisheye.add_argument("--count", type=int, default=16, help="pictures to take with --live, at least")
    fisheye.add_argument("--from", dest="source", type=Path, help="another tool's calibration instead (OpenCV, ROS …)")
    fisheye.add_argument("--max-angle", type=float, default=90.0, help="edge of the image circle with --from, deg")
    fisheye.add_argument("--camera", metavar="NAME", help="which one of a file of several, with --from")
    fisheye.add_argument(
        "--size", metavar="WxH", help="of the pictures, px, with --from: where the file does not say it"
    )
    models = ["unified", "kannala_brandt", "perspective"]
    fisheye.add_argument("--model", choices=models, help="default unified; with --from: what the file says")
    fisheye.add_argument("--report", type=Path, help="HTML")
    fisheye.set_defaults(run=_fisheye)


def _add_ptz(steps: argparse._SubParsersAction[Any], parents: list[argparse.ArgumentParser]) -> None:
    for name, text, run in (
        ("zoom", "the PTZ's lens over zoom (and, without a board, the head)", _zoom),
        ("head", "the head from boards at rest", _head),
    ):
        step = steps.add_parser(name, parents=parents, help=text)
        live = name == "zoom"
        listed = "list of PTZ pictures with their angles (JSON)"
        step.add_argument("shots", type=Path, nargs="?" if live else None, help=listed)
        if live:
            step.add_argument("--live", action="store_true", help="drive the PTZ of --config; hold the board before it")
            step.add_argument("--config", type=Path, help="settings that name the PTZ, with --live")
            step.add_argument("--zooms", default="1,420,1350,3500,7000", help="zoom units, separated by commas")
            step.add_argument("--count", type=int, default=8, help="pictures at each zoom with --live, at least")
        step.set_defaults(run=run)


def _positive(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not 0.0 < value < math.inf:
        raise argparse.ArgumentTypeError(f"{text!r}: give a number above 0")
    return value


def _say(text: str) -> None:
    console = terminal.console(stderr=True, soft_wrap=True)
    console.print(plain_lines(text), style="dim", markup=False)


def _show(outcome: Outcome, *, as_json: bool) -> int:
    if as_json:
        print(json.dumps({**outcome.document, "written": [str(path) for path in outcome.written]}))
    else:
        print("\n".join(outcome.lines))
        for path in outcome.written:
            print(f"written: {path}")
    return 0


def _target(arguments: argparse.Namespace) -> Target:
    if arguments.board is None:
        raise CalibrationError("board: give its size with --board COLUMNSxROWS, counting inner corners or circles")
    return replace(parse_target(arguments.kind, arguments.board, arguments.pitch), dictionary=arguments.dictionary)


def _capture(arguments: argparse.Namespace) -> int:
    from ptzd.app.capturing import capture
    from ptzd.calibrate.capture import ZOOMS

    zooms = ZOOMS if arguments.zooms is None else _numbers(arguments.zooms)
    pan, tele = _pair("--pan", arguments.pan), _pair("--tele", arguments.tele)
    if pan is not None and pan[0] >= pan[1]:
        raise CalibrationError(
            f"--pan {arguments.pan}: the first must be below the second; over 180° count on: 100,260"
        )
    path = asyncio.run(capture(arguments.config, arguments.work, zooms, _say, pan_deg=pan, tele_deg=tele))
    print(f"written: {path}")
    return 0


def _pair(option: str, text: str | None) -> tuple[float, float] | None:
    if text is None:
        return None
    values = _numbers(text)
    if len(values) != 2:
        raise CalibrationError(f"{option} {text}: two numbers separated by a comma are expected")
    return values[0], values[1]


def _simulate(arguments: argparse.Namespace) -> int:
    from ptzd.calibrate.studio import Studio

    target = Target(columns=8, rows=6, pitch_m=0.03)
    studio = Studio(arguments.scene, arguments.profile, arguments.work, target, arguments.seed)
    written = [studio.boards(), studio.zooms(), studio.pairs()] if arguments.boards else [studio.scene_only()]
    for path in written:
        print(f"written: {path}")
    return 0


def _fisheye(arguments: argparse.Namespace) -> int:
    from ptzd.calibrate import parts
    from ptzd.calibrate.report import fisheye_report

    if arguments.source is not None:
        return _import(arguments)
    if arguments.camera is not None or arguments.size is not None or arguments.model == "perspective":
        raise CalibrationError("fisheye: --camera, --size and --model perspective go with --from a calibration")
    pictures = _live(arguments) if arguments.live else arguments.pictures
    if pictures is None:
        raise CalibrationError(
            "fisheye: give the folder with pictures of the board, --live with --config, or --from a calibration"
        )
    outcome, fit, boards = parts.fisheye(
        pictures, _target(arguments), arguments.work, arguments.model or "unified", _say
    )
    report = arguments.report or arguments.work / "fisheye.html"
    report.write_text(fisheye_report(outcome, fit, boards), encoding="utf-8")
    return _show(replace(outcome, written=(*outcome.written, report)), as_json=arguments.json)


def _import(arguments: argparse.Namespace) -> int:
    from ptzd.calibrate.imported import foreign
    from ptzd.calibrate.report import import_report
    from ptzd.calibration.foreign.described import Asked

    if arguments.pictures is not None or arguments.live:
        raise CalibrationError("fisheye: give pictures or --from a calibration, not both")
    asked = Asked(
        model=arguments.model,
        size_px=None if arguments.size is None else _size(arguments.size),
        max_angle_rad=math.radians(arguments.max_angle),
        camera=arguments.camera,
    )
    outcome, camera, reach = foreign(arguments.source, arguments.work, asked)
    report = arguments.report or arguments.work / "fisheye.html"
    report.write_text(import_report(outcome, camera, reach), encoding="utf-8")
    return _show(replace(outcome, written=(*outcome.written, report)), as_json=arguments.json)


def _size(text: str) -> tuple[int, int]:
    width, _, height = text.lower().replace("×", "x").partition("x")
    if not (width.isdecimal() and height.isdecimal() and len(text) < 16):
        raise CalibrationError(f"--size {text}: give width and height in px, as 1920x1080")
    return int(width), int(height)


def _live(arguments: argparse.Namespace) -> Path:
    """Pictures taken now; the folder that keeps them."""
    from ptzd.app.capturing import record
    from ptzd.calibration.guide import Goal

    config = _settings(arguments)
    folder, goal = arguments.pictures or arguments.work / "fisheye", Goal(pictures=arguments.count)
    with _guidance() as show:
        return asyncio.run(record(config, _target(arguments), folder, goal, show))


def _live_zooms(arguments: argparse.Namespace) -> Path:
    """Pictures of the PTZ taken now; their list."""
    from ptzd.app.capturing import record_zooms
    from ptzd.calibration.guide import Goal

    config, goal = _settings(arguments), Goal(pictures=arguments.count, covered=0.7)
    zooms = _numbers(arguments.zooms)
    with _guidance() as show:
        return asyncio.run(record_zooms(config, _target(arguments), arguments.work, zooms, goal, show))


def _settings(arguments: argparse.Namespace) -> Path:
    if arguments.config is None:
        raise CalibrationError("--live: give the daemon's settings with --config, they name the cameras")
    return Path(arguments.config)


def _numbers(text: str) -> tuple[int, ...]:
    try:
        return tuple(int(zoom) for zoom in text.split(","))
    except ValueError:
        raise CalibrationError(f"--zooms {text}: give whole numbers separated by commas") from None


@contextmanager
def _guidance() -> Iterator[Callable[[Advice], None]]:
    """A bar of the covered field on the terminal, with what to do now."""
    from ptzd.calibration.guide import Action

    console = terminal.console(stderr=True, soft_wrap=True)
    columns = (BarColumn(), TaskProgressColumn(), TextColumn("{task.description}", markup=False))
    with Progress(*columns, console=console) as progress:
        task = progress.add_task("waiting for the camera", total=1.0)

        def show(advice: Advice) -> None:
            progress.update(task, completed=advice.covered, description=plain(f"{advice.taken} taken; {advice.text}"))
            if advice.action is Action.TAKE:
                console.print(f"picture {advice.taken}: {advice.covered:.0%} of the field covered", style="dim")

        yield show


def _zoom(arguments: argparse.Namespace) -> int:
    from ptzd.calibrate import head, parts

    shots = _live_zooms(arguments) if arguments.live else arguments.shots
    if shots is None:
        raise CalibrationError("zoom: give the list of pictures, or --live with --config and --board")
    if arguments.board is None:
        outcome = head.turning(shots, arguments.work, _say)
    else:
        outcome = parts.zoom_from_boards(shots, _target(arguments), arguments.work, _say)
    return _show(outcome, as_json=arguments.json)


def _head(arguments: argparse.Namespace) -> int:
    from ptzd.calibrate import head

    outcome = head.head_from_boards(arguments.shots, _target(arguments), arguments.work, _say)
    return _show(outcome, as_json=arguments.json)


def _rig(arguments: argparse.Namespace) -> int:
    from ptzd.calibrate.report import rig_report
    from ptzd.calibrate.rig import rig_from_boards, rig_from_scene

    report = arguments.report or arguments.out.with_suffix(".html")
    if arguments.board is None:
        picture = _picture(arguments)
        limit_rad = math.inf if arguments.accept else math.radians(arguments.limit)
        result = rig_from_scene(arguments.shots, picture, arguments.work, arguments.out, _say, limit_rad=limit_rad)
        outcome, rig = result.outcome, result.rig
        pixels, residuals = result.fit.pairs.fisheye_px, result.fit.residuals_px
    else:
        target = _target(arguments)
        outcome, rig, fit = rig_from_boards(arguments.shots, target, arguments.work, arguments.out, _say)
        picture, (pixels, residuals) = _picture(arguments), fit.fisheye_points()
    report.write_text(rig_report(outcome, rig, picture, arguments.shots, pixels, residuals), encoding="utf-8")
    return _show(replace(outcome, written=(*outcome.written, report)), as_json=arguments.json)


def _picture(arguments: argparse.Namespace) -> Path:
    from ptzd.calibrate.parts import read_shots

    if arguments.fisheye is not None:
        return Path(arguments.fisheye)
    named = [shot.fisheye for shot in read_shots(arguments.shots) if shot.fisheye is not None]
    if not named:
        raise CalibrationError(f"{arguments.shots}: no entry names a fisheye picture; give it with --fisheye")
    return Path(arguments.shots.parent / named[0])


def _verify(arguments: argparse.Namespace) -> int:
    from ptzd.calibrate import verify

    if arguments.board is None:
        outcome = verify.with_scene(arguments.shots, _picture(arguments), arguments.calibration)
    else:
        outcome = verify.with_boards(arguments.shots, _target(arguments), arguments.calibration)
    if arguments.truth is not None:
        more = asyncio.run(verify.with_truth(arguments.truth, arguments.calibration))
        outcome = replace(outcome, lines=(*outcome.lines, *more.lines), document={**outcome.document, **more.document})
    return _show(outcome, as_json=arguments.json)


def _drift(arguments: argparse.Namespace) -> int:
    from ptzd.calibrate.drift import drift

    if arguments.undo:
        return _undo_drift(arguments)
    if not arguments.logs or arguments.calibration is None:
        raise CalibrationError("drift: give logs and, with --calibration, the rig.yaml that was in use")
    return _show(drift(arguments.logs, arguments.calibration, arguments.out), as_json=arguments.json)


def _undo_drift(arguments: argparse.Namespace) -> int:
    from ptzd.app.loading import load
    from ptzd.calibrate.refined import undo

    if arguments.config is None:
        raise CalibrationError("--undo: give the daemon's settings with --config")
    kept = undo(load(arguments.config).config)
    print(f"taken back, kept as {kept}; restart the daemon to use the calibration of its settings")
    return 0
