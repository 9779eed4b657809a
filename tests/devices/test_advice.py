"""Advice that names a setting names one that exists."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import msgspec
import pytest

import ptzd
from ptzd.calibration.document import Document
from ptzd.config import Config

ROOM = Path(ptzd.__file__).parent
PARTS = ("fisheye", "ptz", "limits", "search", "lock", "home", "queue", "bus", "log", "drift")
NAMED = re.compile(rf"(?<![\w./-])(?:{'|'.join(PARTS)})\.[a-z][a-z0-9_]+")
ENDINGS = (".mcap", ".png", ".html", ".part")
"""Names of files, which look alike."""


def settings(kind: type[msgspec.Struct], head: str = "") -> set[str]:
    """Dotted names of every key that a file of settings or a calibration may hold."""
    tag = kind.__struct_config__.tag_field
    names = {head + tag} if tag else set()
    for field in msgspec.structs.fields(kind):
        names.add(head + field.encode_name)
        for part in kinds_of(field.type):
            names |= settings(part, f"{head}{field.encode_name}.")
    return names


def kinds_of(annotation: object) -> list[type[msgspec.Struct]]:
    if isinstance(annotation, type) and issubclass(annotation, msgspec.Struct):
        return [annotation]
    return [kind for part in getattr(annotation, "__args__", ()) for kind in kinds_of(part)]


KNOWN = settings(Config) | settings(Document)


def messages() -> list[tuple[str, str]]:
    """Every text of the product that names a setting, with its file: docstrings are no messages."""
    found = []
    for path in sorted(ROOM.rglob("*.py")):
        tree = ast.parse(path.read_text())
        docs = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
        for node in ast.walk(tree):
            if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in docs:
                found += [(str(path.relative_to(ROOM)), name) for name in NAMED.findall(node.value)]
    return sorted({(file, name) for file, name in found if not name.endswith(ENDINGS)})


@pytest.mark.parametrize(("file", "name"), messages())
def test_a_setting_that_a_message_names_exists(file, name):
    assert name in KNOWN, f"{file} advises {name}"


@pytest.mark.parametrize("source", ["ptz", "fisheye"])
@pytest.mark.parametrize("key", ["url", "user", "password_file", "allow_basic_over_http", "certificate_sha256"])
def test_what_is_advised_for_any_camera_exists_for_both(source, key):
    """Messages of the client are put together from the part's name and the key."""
    assert f"{source}.{key}" in KNOWN
