"""Commands that need no camera and no bus: files in, files and answers out."""

from __future__ import annotations

import argparse
import json
import math
import sys
import time
from collections.abc import Iterable
from pathlib import Path

import cv2
import msgspec
from rich.console import Console
from rich.progress import Progress

from ptzd.app import locating
from ptzd.app.replaying import replay as replay_file
from ptzd.control.states import mermaid
from ptzd.errors import LogError
from ptzd.replay.drive import Replay, time_span_ns

SHOWN_DIFFERENCES = 20


def locate(arguments: argparse.Namespace) -> int:
    """Find a region in pictures; exit 0 when found."""
    located = locating.locate(
        calibration=arguments.calibration,
        fisheye=arguments.fisheye,
        box=arguments.box,
        views=arguments.views,
        matcher=arguments.matcher,
        range_m=arguments.range,
    )
    if arguments.draw is not None and not cv2.imwrite(str(arguments.draw), locating.draw(located)):
        raise locating.DataError(f"{arguments.draw}: the picture cannot be written; end its name in .png or .jpg")
    document = locating.document(located)
    if arguments.json:
        print(json.dumps(document))
    elif locating.found(located):
        print(f"found in view {document['view']}: pan {document['pan_deg']:.3f}°, tilt {document['tilt_deg']:.3f}°")
        print(f"range {document['range_m']} m, probability {document['probability']:.3f}, VAPIX {document['vapix']}")
    else:
        print(f"{document['outcome']}: {document['reason']}")
    return 0 if locating.found(located) else 1


def plan(arguments: argparse.Namespace) -> int:
    """List the views of a scan."""
    planned = locating.plan(
        calibration=arguments.calibration, box=arguments.box, zoom=arguments.zoom, range_m=arguments.range
    )
    views = [
        {
            "pan_deg": round(view.reading.pan_deg, 4),
            "tilt_deg": round(view.reading.tilt_deg, 4),
            "zoom": view.reading.zoom,
            "hfov_deg": round(math.degrees(view.hfov_rad), 4),
        }
        for view in planned.views
    ]
    if arguments.json:
        print(json.dumps(views))
    else:
        for number, view in enumerate(views, 1):
            print(f"{number}: " + ", ".join(f"{name} {value:g}" for name, value in view.items()))
    return 0


def replay(arguments: argparse.Namespace) -> int:
    """Replay a file or a folder; exit 0 when nothing differs."""
    files = sorted(arguments.log.glob("*.mcap")) if arguments.log.is_dir() else [arguments.log]
    if not files:
        raise LogError(f"{arguments.log}: no .mcap files in this folder")
    reports = [_replay_one(path, arguments) for path in files]
    if arguments.json:
        print(json.dumps(reports if arguments.log.is_dir() else reports[0]))
    return 0 if all(report["same"] for report in reports) else 1


def _replay_one(path: Path, arguments: argparse.Namespace) -> dict[str, object]:
    first, last = time_span_ns(path)
    console = Console(file=sys.stderr)
    started = time.perf_counter()
    with Progress(console=console, transient=True, disable=not console.is_terminal) as progress:
        bar = progress.add_task(path.name, total=(last - first) / 1e9)
        found = replay_file(
            path,
            recompute=arguments.recompute,
            config_path=arguments.config,
            calibration_path=arguments.calibration,
            advanced=lambda t_ns: progress.update(bar, completed=(t_ns - first) / 1e9),
        )
    speed = found.span_s / max(time.perf_counter() - started, 1e-9)
    if not arguments.json:
        _print_replay(path, found, speed)
    return {
        "file": str(path),
        "same": found.same,
        "events": found.events,
        "commands": found.commands,
        "matches": found.matches,
        "requests": {name: result.outcome.value for name, result in found.recorded.items()},
        "differences": [msgspec.to_builtins(difference) for difference in found.differences],
        "speed_over_real_time": round(speed, 1),
    }


def _print_replay(path: Path, found: Replay, speed: float) -> None:
    verdict = "no difference" if found.same else f"{len(found.differences)} differences"
    recomputed = f", {found.matches} matches computed anew" if found.matches else ""
    print(f"{path}: {verdict}: {found.events} events, {found.commands} commands{recomputed}; {speed:.0f}× real time")
    for difference in found.differences[:SHOWN_DIFFERENCES]:
        print(f"  {difference}")
    if len(found.differences) > SHOWN_DIFFERENCES:
        print(f"  … and {len(found.differences) - SHOWN_DIFFERENCES} more")
    for name in sorted(found.recorded.keys() | found.replayed.keys()):
        was, now = found.recorded.get(name), found.replayed.get(name)
        ended = "–" if was is None else was.outcome
        other = "–" if now is None else now.outcome
        print(f"  {name}: {ended}" + ("" if ended == other else f", replayed {other}"))


def schema(arguments: argparse.Namespace) -> int:
    """Print the JSON Schema of one message, or the names of all."""
    from ptzd.app.clients import message_schema, message_types

    names = message_types()
    if arguments.type is None:
        print("\n".join(names))
    elif arguments.type in names:
        print(json.dumps(message_schema(arguments.type), indent=2))
    else:
        raise locating.DataError(f"schema: no message {arguments.type}; there are {', '.join(names)}")
    return 0


def states(arguments: argparse.Namespace) -> int:
    """Print the state diagram."""
    del arguments
    print(mermaid())
    return 0


def log_info(arguments: argparse.Namespace) -> int:
    """What a log holds, told per request."""
    from ptzd.app import logs

    return _print_lines(logs.info(arguments.file, as_json=arguments.json))


def log_recover(arguments: argparse.Namespace) -> int:
    """Repair a torn log."""
    from ptzd.app import logs

    return _print_lines(logs.recovered(arguments.file, as_json=arguments.json))


def log_export(arguments: argparse.Namespace) -> int:
    """Write tables, pages and pictures of a log."""
    from ptzd.app import logs

    lines = logs.exported(
        arguments.file, arguments.out, arguments.request, pictures=arguments.pictures, as_json=arguments.json
    )
    return _print_lines(lines)


def _print_lines(lines: Iterable[str]) -> int:
    for line in lines:
        print(line)
    return 0
