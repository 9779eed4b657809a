"""The command line's one way out: whatever is printed, nothing that came from outside steers the terminal."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Iterator
from typing import Any, TextIO, cast

from rich.console import Console

from ptzd.plain import plain_lines


class PlainStream:
    """A text stream that writes control characters out; everything else is the stream's own.

    Parameters
    ----------
    stream : TextIO
        Where it goes.
    """

    def __init__(self, stream: TextIO) -> None:
        self.stream = stream

    def write(self, text: str) -> int:
        """Write text, whatever it holds."""
        self.stream.write(plain_lines(text))
        return len(text)

    def writelines(self, lines: list[str]) -> None:
        """Write each."""
        for line in lines:
            self.write(line)

    def __getattr__(self, name: str) -> Any:  # noqa: ANN401 - whatever the stream has
        return getattr(self.stream, name)


@contextlib.contextmanager
def plain_output() -> Iterator[None]:
    """Standard output and error are plain inside."""
    out, err = sys.stdout, sys.stderr
    sys.stdout, sys.stderr = cast("TextIO", PlainStream(out)), cast("TextIO", PlainStream(err))
    try:
        yield
    finally:
        sys.stdout, sys.stderr = out, err


def console(*, stderr: bool = False, soft_wrap: bool = False) -> Console:
    """Colours and progress bars steer the terminal themselves; text of others goes in by :func:`ptzd.plain.plain`."""
    stream = sys.stderr if stderr else sys.stdout
    return Console(file=getattr(stream, "stream", stream), highlight=False, soft_wrap=soft_wrap)
