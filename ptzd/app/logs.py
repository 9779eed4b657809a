"""`ptzd log`: contents, repair, export."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from pathlib import Path

from ptzd.log.recover import recover


def recovered(path: Path, out: Path | None, *, as_json: bool) -> Iterator[str]:
    """Repair a torn file in place."""
    del out
    report = recover(path)
    if as_json:
        yield json.dumps({"file": str(report.path), "messages": report.messages, "bytes_cut": report.bytes_cut})
    else:
        yield f"{report.path}: {report.note}"


ACTIONS: dict[str, Callable[..., Iterator[str]]] = {"recover": recovered}
