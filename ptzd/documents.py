"""The one loader of YAML that people write: settings, calibrations, scenes, scripts.

Stricter than YAML: no key twice in a mapping (the last would win) and none but texts, at most `MOST_WRITTEN` values, no
aliases that write the document out beyond `LARGEST_NODES` or contain themselves, no nesting beyond `DEEPEST`, no dates
(a text stays a text), no number that Python cannot hold. What is wrong is told with its line.
"""

from __future__ import annotations

import errno
import json
import os
import re
import stat
from collections.abc import Hashable
from pathlib import Path
from typing import Any

import yaml

DEEPEST = 32
"""Mappings and lists inside each other; settings need four, calibrations five."""
MOST_WRITTEN = 50_000
"""Keys and values of a document as written, some 1 s to read; a foreign calibration with its corners has 20,000."""
LARGEST_NODES = 200_000
"""Values of a document with every alias written out."""
LARGEST_BYTES = 1_000_000
"""Of a file; the largest calibration with its covariances has some 20 kB."""


class DocumentError(Exception):
    """A text that is no document; one line with the place, without the file's name."""


class _Loader(yaml.SafeLoader):
    """SafeLoader without what people do not mean."""

    def __init__(self, stream: str) -> None:
        super().__init__(stream)
        self._depth = 0
        self._written = 0

    def compose_node(self, parent: yaml.Node | None, index: int) -> yaml.Node | None:
        event = self.peek_event()  # type: ignore[no-untyped-call]
        self._depth += 1
        self._written += 1
        if self._depth > DEEPEST:
            raise DocumentError(f"{_place(event.start_mark)}: nested deeper than {DEEPEST} levels")
        if self._written > MOST_WRITTEN:
            raise DocumentError(f"{_place(event.start_mark)}: more than {MOST_WRITTEN:,} values; is it the right file?")
        try:
            return super().compose_node(parent, index)
        finally:
            self._depth -= 1

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Hashable, Any]:
        seen: set[Hashable] = set()
        for key_node, _ in node.value:
            if key_node.tag == "tag:yaml.org,2002:merge":
                raise DocumentError(f"{_place(key_node.start_mark)}: merge keys (<<) are not taken; write the keys out")
            key = self.construct_object(key_node, deep=True)
            if not isinstance(key, Hashable):
                raise DocumentError(f"{_place(key_node.start_mark)}: a key must be a plain word")
            if not isinstance(key, str):
                raise DocumentError(f"{_place(key_node.start_mark)}: {_no_word(key_node, key)}")
            if key in seen:
                raise DocumentError(f"{_place(key_node.start_mark)}: key {key!r} is given twice")
            seen.add(key)
        return super().construct_mapping(node, deep=deep)


_NUMBERS = {"tag:yaml.org,2002:int", "tag:yaml.org,2002:float"}


def _int(loader: yaml.SafeLoader, node: yaml.ScalarNode) -> int:
    try:
        return loader.construct_yaml_int(node)
    except ValueError:
        raise DocumentError(f"{_place(node.start_mark)}: not a whole number that can be read") from None


_Loader.yaml_implicit_resolvers = {
    first: [(tag, pattern) for tag, pattern in resolvers if tag not in {"tag:yaml.org,2002:timestamp"}]
    for first, resolvers in yaml.SafeLoader.yaml_implicit_resolvers.items()
}
for _first, _resolvers in _Loader.yaml_implicit_resolvers.items():
    # 22:00 is a text, no number of base 60: as in YAML 1.2
    _Loader.yaml_implicit_resolvers[_first] = [
        (tag, re.compile(f"(?!.*:)(?:{pattern.pattern})", pattern.flags) if tag in _NUMBERS else pattern)
        for tag, pattern in _resolvers
    ]
_Loader.add_implicit_resolver(
    "tag:yaml.org,2002:float",
    re.compile(r"^[-+]?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)[eE][-+]?[0-9]+$"),  # 1e-3 is a number, as in YAML 1.2
    list("-+.0123456789"),
)
_Loader.add_constructor("tag:yaml.org,2002:int", _int)


def _no_word(node: yaml.Node, key: object) -> str:
    """What is wrong with a key that YAML takes for something else than a text."""
    written = str(node.value)
    if not written:
        return "there is no key in front of the colon"
    read_as = "nothing" if key is None else f"the {'word' if isinstance(key, bool) else 'number'} {key}".lower()
    return f'the key {written} is read as {read_as}; a key must be a text: correct it, or write "{written}"'


def _place(mark: yaml.Mark) -> str:
    return f"line {mark.line + 1}, column {mark.column + 1}"


def _count(node: yaml.Node, known: dict[int, int], above: set[int]) -> int:
    """Number of values in a node with its aliases written out."""
    name = id(node)
    if name in above:
        raise DocumentError(f"{_place(node.start_mark)}: an alias inside what it stands for has no end")
    if name not in known:
        children = node.value if isinstance(node, yaml.CollectionNode) else []
        pairs = isinstance(node, yaml.MappingNode)
        inner = [child for item in children for child in (item if pairs else (item,))]
        known[name] = 1 + sum(_count(child, known, above | {name}) for child in inner)
        if known[name] > LARGEST_NODES:
            raise DocumentError(f"{_place(node.start_mark)}: aliases make more than {LARGEST_NODES:,} values of it")
    return known[name]


def parse_yaml(text: str) -> object:
    """Return the plain values of a text: mappings, lists, texts, numbers, booleans, None.

    Raises
    ------
    DocumentError
        As in the module's docstring, or no YAML.
    """
    try:
        loader = _Loader(text)
        try:
            node = loader.get_single_node()
            if node is None:
                return None
            _count(node, {}, set())
            return loader.construct_document(node)
        finally:
            loader.dispose()
    except yaml.MarkedYAMLError as error:
        place = "" if error.problem_mark is None else f"{_place(error.problem_mark)}: "
        raise DocumentError(f"{place}not YAML: {' '.join(str(error.problem or error).split())}") from None
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        raise DocumentError(f"not YAML: {' '.join(str(error).split())}") from None


def parse_json(text: str) -> object:
    """Return the plain values of a JSON text; DocumentError as for `parse_yaml`."""
    try:
        return json.loads(text, object_pairs_hook=_once)
    except (ValueError, RecursionError) as error:
        raise DocumentError(f"not JSON: {' '.join(str(error).split())}") from None


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for key, value in pairs:
        if key in found:
            raise DocumentError(f"key {key!r} is given twice")
        found[key] = value
    return found


def parse_mapping(text: str) -> dict[str, Any]:
    """Parse a text that must be a mapping at the top; DocumentError when it is something else."""
    document = parse_yaml(text)
    if not isinstance(document, dict):
        raise DocumentError(f"holds {type(document).__name__}, no mapping")
    return document


def open_regular(path: Path) -> int:
    """Open a file that somebody named, for reading; returns its descriptor.

    Raises
    ------
    OSError
        It cannot be opened, or is no regular file: a pipe would be waited for without end, and with it whoever waits.
    """
    descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    if stat.S_ISREG(os.fstat(descriptor).st_mode):
        return descriptor
    os.close(descriptor)
    raise OSError(errno.EINVAL, "is no regular file", str(path))


def read_regular(path: Path, most: int = -1) -> bytes:
    """Read a regular file, at most so many bytes; OSError as of `open_regular`."""
    with os.fdopen(open_regular(path), "rb") as file:
        return file.read(most)


def read_text(path: Path) -> str:
    """Read a file of at most `LARGEST_BYTES`.

    Raises
    ------
    OSError
        It cannot be read.
    DocumentError
        It is too large or no UTF-8.
    """
    data = read_regular(path, LARGEST_BYTES + 1)
    if len(data) > LARGEST_BYTES:
        raise DocumentError(f"larger than {LARGEST_BYTES:,} bytes; is it the right file?")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise DocumentError(f"no UTF-8 text, at byte {error.start}") from None
