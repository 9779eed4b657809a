"""`ptzd replay`: files in, differences out."""

from __future__ import annotations

import argparse
import json
from pathlib import Path

from rich.progress import Progress

from ptzd.app import replaying
from ptzd.cli import terminal
from ptzd.errors import LogError
from ptzd.replay import report
from ptzd.replay.drive import Replay

SAME, DIFFERS = 0, 1


def replay(arguments: argparse.Namespace) -> int:
    """Replay a file, or every file of a folder alone; exit 0 when nothing differs, 65 when one cannot be read."""
    folder = arguments.log.is_dir()
    files = sorted(arguments.log.glob("*.mcap")) if folder else [arguments.log]
    if not files:
        raise LogError(f"{arguments.log}: no .mcap files in this folder")
    reports = []
    for path in files:
        reports.append(_replay_one(path, arguments))
        if not arguments.json:
            for line in report.lines(reports[-1]):
                print(line)
    if arguments.json:
        documents = [report.document(one) for one in reports]
        print(json.dumps(documents if folder else documents[0]))
    if arguments.junit is not None:
        _write(arguments.junit, report.junit(reports))
    if any(one.error for one in reports):
        return LogError.exit_code
    return SAME if all(one.same for one in reports) else DIFFERS


def _replay_one(path: Path, arguments: argparse.Namespace) -> report.Report:
    """A file that cannot be read ends the command when it was named, and is reported when it lies in a folder."""
    try:
        return report.Report(path=path, replay=_with_progress(path, arguments))
    except LogError as error:
        if not arguments.log.is_dir() and arguments.junit is None:
            raise
        return report.Report(path=path, error=str(error))


def _with_progress(path: Path, arguments: argparse.Namespace) -> Replay:
    first, last = replaying.time_span_ns(path)
    console = terminal.console(stderr=True)
    with Progress(console=console, transient=True, disable=not console.is_terminal) as progress:
        bar = progress.add_task(path.name, total=(last - first) / 1e9)
        return replaying.replay(
            path,
            recompute=arguments.recompute,
            config_path=arguments.config,
            calibration_path=arguments.calibration,
            advanced=lambda t_ns: progress.update(bar, completed=(t_ns - first) / 1e9),
        )


def _write(path: Path, text: str) -> None:
    try:
        path.write_text(text)
    except OSError as error:
        raise LogError(f"{path}: the report cannot be written: {error.strerror}") from None
