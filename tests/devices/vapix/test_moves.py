"""A few random moves of the bench on every kind of camera; the command exits with 1 when a law is broken."""

from __future__ import annotations

import asyncio
import sys
from pathlib import Path

ROOT = Path(__file__).parents[3]


async def test_random_moves_arrive_in_time_and_in_place():
    process = await asyncio.create_subprocess_exec(
        sys.executable, "-m", "tests.bench.moves", "--moves", "20",
        cwd=ROOT, stdout=asyncio.subprocess.PIPE, stderr=asyncio.subprocess.PIPE,
    )  # fmt: skip
    table, complaints = (text.decode() for text in await process.communicate())
    assert process.returncode == 0, complaints
    assert table.count(" refused |") == 7
