"""Accuracy of both matchers and of the usual peers on every row of the paper's experiments and beyond.

    python -m tests.bench.accuracy [--quick] [--write] [--json OUT.json]

Scenes room, yard and warehouse (rendered first where needed), the motorcycle pair and two real 360° pairs. Prints one
table in Markdown; ``--write`` also puts it with its plots into docs/ and its summary into README.md. A full run takes
about a quarter of an hour on two idle cores, half of it for the peers, whose answers are kept in build/bench until the
pictures change.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

from tests.bench import report, running
from tests.bench.conditions import CONDITIONS, QUICK
from tests.bench.real import REAL

SCENES = ("room", "yard", "warehouse")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scene", default=",".join((*SCENES, *REAL)), help="names, joined by commas")
    parser.add_argument("--only", default="", help="conditions, joined by commas; default: all")
    parser.add_argument("--matchers", default=",".join(running.RUNNERS))
    parser.add_argument("--every", type=int, default=1, help="only every n-th region")
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--quick", action="store_true", help="some conditions, every third region, without the peers")
    parser.add_argument("--fresh", action="store_true", help="ask the peers again")
    parser.add_argument("--json", type=Path, default=Path("build/bench/accuracy.json"), help="all answers")
    parser.add_argument("--from-json", type=Path, help="no run: the answers of an earlier one")
    parser.add_argument("--write", action="store_true", help="into docs/ and README.md")
    args = parser.parse_args()
    records = json.loads(args.from_json.read_text()) if args.from_json else asked(args)
    print(report.table(records))
    if args.write:
        report.write(records)
    return 0


def asked(args: argparse.Namespace) -> list[running.Record]:
    """Run what the arguments say."""
    conditions = [condition.name for condition in CONDITIONS]
    conditions = [name for name in conditions if not args.only or name in args.only.split(",")]
    matchers, every = args.matchers.split(","), args.every
    if args.quick:
        conditions, matchers, every = list(QUICK), ["sweep", "harris"], 3
    if args.fresh:
        running.KEPT.unlink(missing_ok=True)
    records = running.with_kept_peers(args.scene.split(","), conditions, matchers, every, args.processes)
    args.json.parent.mkdir(parents=True, exist_ok=True)
    args.json.write_text(json.dumps(records, indent=0))
    return records


if __name__ == "__main__":
    sys.exit(main())
