"""docs/architecture.md says where things are written: its rooms are the code's, what it names is there."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

from tests.structure.graph import MARKED, PAGE, ROOT, rooms

RULE = re.compile(
    r"^\| (?P<rule>[^|]+) \| `(?P<path>[\w/]+\.py)` (?P<names>`[^|]+`) \| `(?P<test>test_\w+)` \|$", re.MULTILINE
)
RULES = [found.groupdict() for found in RULE.finditer(PAGE.read_text())]


def defined(path: Path) -> set[str]:
    """Names that a module defines: at its top, and in its classes with the class before them."""
    found: set[str] = set()
    for node in ast.parse(path.read_text()).body:
        if isinstance(node, ast.ClassDef | ast.FunctionDef):
            found.add(node.name)
        if isinstance(node, ast.ClassDef):
            found |= {f"{node.name}.{part.name}" for part in node.body if isinstance(part, ast.FunctionDef)}
        targets = node.targets if isinstance(node, ast.Assign) else [getattr(node, "target", None)]
        found |= {target.id for target in targets if isinstance(target, ast.Name)}
    return found


def test_the_rooms_are_those_of_the_code() -> None:
    shown = MARKED.search(PAGE.read_text())
    assert shown is not None
    assert shown[2] == rooms(), "renew it: python -m tests.structure.graph --write"


def test_every_row_of_the_rules_is_read() -> None:
    table = PAGE.read_text().partition("| rule | written in | shown by |")[2]
    assert len(RULES) == table.count("\n| ") > 20


@pytest.mark.parametrize("rule", RULES, ids=lambda rule: rule["rule"])
def test_a_rule_is_written_where_the_page_says(rule: dict[str, str]) -> None:
    there = defined(ROOT / rule["path"])
    assert [name for name in re.findall(r"`([\w.]+)`", rule["names"]) if name not in there] == []


def test_every_test_that_the_page_names_is_there() -> None:
    texts = "\n".join(path.read_text() for path in (ROOT / "tests").rglob("test_*.py"))
    assert [rule["test"] for rule in RULES if f"def {rule['test']}(" not in texts] == []
