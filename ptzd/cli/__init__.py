"""The command line: arguments, one call per command, exit codes, human output and ``--json``."""

from __future__ import annotations

import sys
import traceback

from ptzd.cli.parser import parser
from ptzd.errors import PtzdError

EX_OK = 0
EX_DIFFERENT = 1
INTERRUPTED = 130


def entry(argv: list[str] | None = None) -> int:
    """Run one command.

    Returns
    -------
    int
        Exit code: 0, 1 for a no, otherwise as in sysexits.h.
    """
    arguments = parser().parse_args(argv)
    try:
        return int(arguments.run(arguments))
    except PtzdError as error:
        if arguments.debug:
            traceback.print_exc()
        print(f"ptzd: {error}", file=sys.stderr)
        return error.exit_code
    except KeyboardInterrupt:
        return INTERRUPTED
    except BrokenPipeError:
        return EX_OK
