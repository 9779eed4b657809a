"""Whoever asks in a loop for the log to be cut gets one file, not hundreds."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import pytest

from ptzd.app import daemon
from ptzd.errors import LogError


async def test_cuts_that_are_asked_for_are_limited(monkeypatch):
    cuts = []

    async def settled() -> None:
        return None

    log = SimpleNamespace(settled=settled, closed_files=lambda: [Path(f"{len(cuts)}.mcap")])
    owner = SimpleNamespace(pump=SimpleNamespace(cut_log=lambda: cuts.append(1)))
    handle = daemon._log_handler(log, owner)
    assert await handle("rotate") == ["1.mcap"]
    for _ in range(300):
        with pytest.raises(LogError, match=r"cut a moment ago; one in 2 s, again in \d"):
            await handle("rotate")
    assert await handle("list") == ["1.mcap"]
    monkeypatch.setattr(daemon, "CUT_EVERY_S", 0.0)
    await handle("rotate")
    assert len(cuts) == 2
