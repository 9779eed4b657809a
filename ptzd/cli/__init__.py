"""The command line: arguments, one call per command, exit codes, human output and ``--json``."""

from __future__ import annotations

import sys
import traceback
from types import TracebackType

from ptzd.cli.parser import parser
from ptzd.cli.terminal import plain_output
from ptzd.errors import PtzdError, RequestRefused
from ptzd.plain import plain

EX_OK = 0
EX_SOFTWARE = 70
INTERRUPTED = 130


def entry(argv: list[str] | None = None) -> int:
    """Run one command.

    Returns
    -------
    int
        Exit code: 0, 1 for a no, otherwise as in sysexits.h.
    """
    with plain_output():
        return _entered(argv)


def _entered(argv: list[str] | None) -> int:
    arguments = parser().parse_args(argv)
    if not arguments.debug:
        sys.excepthook = report_defect
    try:
        return int(arguments.run(arguments))
    except PtzdError as error:
        if arguments.debug:
            traceback.print_exc()
        print(f"ptzd: {plain(_told(error))}", file=sys.stderr)
        return error.exit_code
    except KeyboardInterrupt:
        return INTERRUPTED
    except BrokenPipeError:
        return EX_OK


def _told(error: PtzdError) -> str:
    """The message, with the field of a message that it is about."""
    if isinstance(error, RequestRefused) and error.field.startswith("$."):
        return f"{error.field.removeprefix('$.')}: {error}"
    return str(error)


def report_defect(kind: type[BaseException], error: BaseException, trace: TracebackType | None) -> None:
    """Tell of an error that nobody foresaw in one line, with its place; exit with 70."""
    place = traceback.extract_tb(trace)[-1] if trace is not None else None
    where = "" if place is None else f" at {place.filename}:{place.lineno}"
    print(
        f"ptzd: internal error{where}: {kind.__name__}: {plain(str(error))}; `ptzd --debug …` shows more",
        file=sys.stderr,
    )
    raise SystemExit(EX_SOFTWARE)
