"""Files that outlive the daemon: changed as a whole or not at all, and never thrown away because they are damaged."""

from __future__ import annotations

import asyncio
import logging
import os
from pathlib import Path

_log = logging.getLogger(__name__)


def put_in_place(path: Path, content: bytes) -> None:
    """Put this in the place of a file at once, so that whoever reads it finds the old or the new one.

    Raises
    ------
    OSError
        It cannot be written; the old one is as it was.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    fresh = path.with_suffix(".new")
    with fresh.open("wb") as file:
        file.write(content)
        file.flush()
        os.fsync(file.fileno())
    fresh.replace(path)


class KeptFile:
    """A file that is written again and again; a disk that takes nothing is told once, until it does."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._failing = False

    async def write(self, content: bytes) -> bool:
        """Put this in its place, off the loop; returns whether it is there."""
        try:
            await asyncio.to_thread(put_in_place, self._path, content)
        except OSError as error:
            if not self._failing:
                _log.warning(
                    "%s cannot be written (%s): a restart would forget what is new", self._path, error.strerror
                )
            self._failing = True
            return False
        self._failing = False
        return True


def put_aside(path: Path) -> str:
    """Keep a damaged file under another name, beside it; returns what became of it, for the journal."""
    aside = path.with_suffix(".damaged")
    try:
        path.replace(aside)
    except OSError as error:
        return f"the file stays where it is ({error.strerror})"
    return f"the file is kept as {aside.name}"
