"""`ptzd log`: contents, repair, export."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

from ptzd.evidence.export import bundle, export
from ptzd.evidence.info import describe, document, lines
from ptzd.log.recover import recover


def info(path: Path, *, as_json: bool) -> Iterator[str]:
    """What a file holds, told per request."""
    summary = describe(path)
    if as_json:
        yield json.dumps(document(summary))
    else:
        yield from lines(summary)


def recovered(path: Path, *, as_json: bool) -> Iterator[str]:
    """Repair a torn file in place."""
    report = recover(path)
    if as_json:
        facts = {"file": str(report.path), "messages": report.messages, "bytes_cut": report.bytes_cut}
        yield json.dumps({**facts, "parts_lost": report.parts_lost, "note": report.note})
    else:
        yield f"{report.path}: {report.note}"


def exported(path: Path, out: Path | None, request: str | None, *, pictures: bool, as_json: bool) -> Iterator[str]:
    """Tables, pages and pictures of a file, or the page of one request."""
    if request is not None:
        page = bundle(path, request, out if out is not None else path.with_name(f"{request}.html"))
        yield json.dumps({"page": str(page)}) if as_json else str(page)
        return
    folder = out if out is not None else path.with_suffix("")
    written = export(path, folder, pictures=pictures)
    facts = {"directory": str(written.directory), "requests": written.requests, "pictures": written.pictures}
    if as_json:
        yield json.dumps(facts)
    else:
        yield f"{written.directory}: {written.requests} requests, {written.pictures} pictures"
