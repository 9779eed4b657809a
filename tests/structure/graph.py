"""The rooms of the package and who imports whom: ``python -m tests.structure.graph`` (or ``make imports``).

A row a room, top layer first, with the rooms that it imports and how many import lines that takes. Exit 1 when an arrow
goes upwards or rooms go round in a circle. With ``--write`` the table of rooms in docs/architecture.md is renewed.
"""

from __future__ import annotations

import ast
import re
import sys
import tomllib
from collections import Counter
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import grimp

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "architecture.md"
MARKED = re.compile(r"(<!-- rooms -->\n)(.*)(<!-- /rooms -->)", re.DOTALL)


def layers() -> list[list[str]]:
    """Rooms of each layer, top first, as the contract in pyproject.toml has them."""
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]["contracts"]
    rows = next(contract["layers"] for contract in contracts if contract["type"] == "layers")
    return [[room.strip(" ()") for room in row.split("|")] for row in rows]


def arrows() -> Counter[tuple[str, str]]:
    """Import lines from room to room."""
    graph = grimp.build_graph("ptzd", cache_dir=None)
    found: Counter[tuple[str, str]] = Counter()
    for module in graph.modules:
        for imported in graph.find_modules_directly_imported_by(module):
            start, end = (name.removeprefix("ptzd").lstrip(".").partition(".")[0] for name in (module, imported))
            if start and end and start != end:
                found[start, end] += 1
    return found


def upwards(found: Counter[tuple[str, str]], rows: list[list[str]]) -> list[tuple[str, str]]:
    """Arrows to a higher layer or to a neighbour in the same one."""
    height = {room: -index for index, row in enumerate(rows) for room in row}
    return sorted((start, end) for start, end in found if height[start] <= height[end])


def circle(found: Counter[tuple[str, str]]) -> list[str]:
    """Rooms that import each other round and round; empty when there are none."""
    sorter: TopologicalSorter[str] = TopologicalSorter()
    for start, end in found:
        sorter.add(start, end)
    try:
        sorter.prepare()
    except CycleError as error:
        return list(error.args[1])
    return []


def rooms() -> str:
    """The table of rooms, top layer first, each with the first paragraph that it says of itself."""
    lines = ["| layer | room | what it is |", "|---|---|---|"]
    for number, row in enumerate(layers(), 1):
        lines += [f"| {number} | `{room}` | {_said(room)} |" for room in row]
    return "\n".join(lines) + "\n"


def _said(room: str) -> str:
    folder, file = ROOT / "ptzd" / room / "__init__.py", ROOT / "ptzd" / f"{room}.py"
    text = ast.get_docstring(ast.parse((folder if folder.exists() else file).read_text())) or ""
    return " ".join(text.split("\n\n")[0].split()).replace("``", "`").rstrip(".")


def main() -> int:
    if "--write" in sys.argv[1:]:
        page = PAGE.read_text()
        PAGE.write_text(MARKED.sub(lambda found: f"{found[1]}{rooms()}{found[3]}", page))
    rows, found = layers(), arrows()
    for room in (room for row in rows for room in row):
        seen = {end: count for (start, end), count in sorted(found.items()) if start == room}
        print(f"{room:12} → {', '.join(f'{end} {count}' for end, count in seen.items()) or 'nothing'}")
    wrong, round_trip = upwards(found, rows), circle(found)
    for start, end in wrong:
        print(f"UPWARDS {start} → {end}")
    if round_trip:
        print(f"CIRCLE {' → '.join(round_trip)}")
    return 1 if wrong or round_trip else 0


if __name__ == "__main__":
    sys.exit(main())
