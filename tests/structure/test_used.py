"""What the package defines, the package uses: nothing is kept for tests alone, and nothing for nobody."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import ptzd

PACKAGE = Path(ptzd.__file__).parent
OFFERED = {
    "PUBLISHED": "the interface: which message goes out on which key",
    "VirtualClock": "the simulator in tests of others, see docs/axis.md",
}
"""Names that are for whoever uses the package."""


def modules() -> dict[Path, ast.Module]:
    return {path: ast.parse(path.read_text()) for path in sorted(PACKAGE.rglob("*.py"))}


def defined(tree: ast.Module) -> Iterator[str]:
    """Functions, classes and constants at the top of a module."""
    for node in tree.body:
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
            yield node.name
        elif isinstance(node, ast.Assign | ast.AnnAssign):
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            yield from (name.id for target in targets for name in ast.walk(target) if isinstance(name, ast.Name))


def used(tree: ast.Module) -> Iterator[str]:
    """Names that are read or imported, also in annotations that are text."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Load):
            yield node.id
        elif isinstance(node, ast.Attribute):
            yield node.attr
        elif isinstance(node, ast.ImportFrom):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.Constant) and isinstance(node.value, str) and node.value.isidentifier():
            yield node.value


def test_everything_that_is_defined_is_used() -> None:
    trees = modules()
    names = {name for tree in trees.values() for name in used(tree)}
    idle = {
        name: path.relative_to(PACKAGE).as_posix()
        for path, tree in trees.items()
        for name in defined(tree)
        if name not in names and not name.startswith("__")
    }
    assert {name: where for name, where in idle.items() if name not in OFFERED} == {}
    assert set(OFFERED) <= set(idle), "used by the package after all"
