"""Files that people write: what YAML would take in silence or choke on is refused with its line."""

from __future__ import annotations

import json
import os
from pathlib import Path

import msgspec
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from ptzd.app import motor_file, ranges_file, simulate
from ptzd.app.loading import load
from ptzd.calibration.foreign.text import read_source
from ptzd.calibration.pictures import read_grey
from ptzd.config import Config, parse_config
from ptzd.control.motor import Travel
from ptzd.control.planning.ranges import RangeMap
from ptzd.devices.files import read_picture
from ptzd.devices.vapix.credentials import read_credentials
from ptzd.documents import (
    DEEPEST,
    LARGEST_BYTES,
    DocumentError,
    parse_json,
    parse_mapping,
    parse_yaml,
    read_regular,
    read_text,
)
from ptzd.errors import ConfigError, PtzdError
from ptzd.log.records import RecordFile
from ptzd.log.recover import recover
from ptzd.sim.scene import _read

plain = st.recursive(
    st.none()
    | st.booleans()
    | st.integers(-(1 << 60), 1 << 60)
    | st.floats(allow_nan=False)
    | st.text("abc: #'\n-", max_size=9),
    lambda part: st.lists(part, max_size=4) | st.dictionaries(st.text("abc", min_size=1, max_size=5), part, max_size=4),
    max_leaves=12,
)


@given(plain)
def test_what_is_written_plainly_reads_back_the_same(value):
    assert parse_yaml(yaml.safe_dump(value)) == value


@given(st.text(max_size=200))
def test_any_text_is_a_document_or_a_named_refusal(text):
    said = ""
    try:
        parse_yaml(text)
    except DocumentError as error:
        said = str(error)
    assert "\n" not in said


LAUGHS = "\n".join(
    ["a0: &a0 [x, x, x, x, x, x, x, x, x, x]"]
    + [f"a{n}: &a{n} [{', '.join([f'*a{n - 1}'] * 10)}]" for n in range(1, 9)]
)


def test_an_alias_stands_for_its_value():
    assert parse_yaml("pan: &axis {sign: 1, scale: 1.0}\ntilt: *axis") == {
        "pan": {"sign": 1, "scale": 1.0},
        "tilt": {"sign": 1, "scale": 1.0},
    }


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("a: 1\nb: 2\na: 3", "line 3, column 1: key 'a' is given twice"),
        ("x:\n  b: {c: 1, d: 2, c: 1}", "line 2, column 19: key 'c'"),
        ("a: &a [*a]", "line 1, column 4: an alias inside what it stands for"),
        ("a: &a {b: {c: *a}}", "has no end"),
        (
            "a: 1\n7: 2",
            'line 2, column 1: the key 7 is read as the number 7; a key must be a text: correct it, or write "7"',
        ),
        ("a: {2.5: 1}", "line 1, column 5: the key 2.5 is read as the number 2.5; a key must be a text"),
        ("a: 1\nnull: 2", "line 2, column 1: the key null is read as nothing; a key must be a text"),
        ("~: 2", "line 1, column 1: the key ~ is read as nothing"),
        ("? \n: 2", "line 1, column 2: there is no key in front of the colon"),
        ("a: 1\non: 2", "line 2, column 1: the key on is read as the word true; a key must be a text"),
        ("a: [" + "1, " * 60_000 + "1]", "line 1, column 14.*: more than 50,000 values; is it the right file?"),
        ("a: {" + ", ".join(f"k{n}: {n}" for n in range(30_000)) + "}", "more than 50,000 values"),
        (LAUGHS, "aliases make more than 200,000 values of it"),
        ("[" * (DEEPEST + 5) + "]" * (DEEPEST + 5), f"nested deeper than {DEEPEST}"),
        ("[" * 100_000, "nested deeper"),
        ("a: " + "9" * 5000, "line 1, column 4: not a whole number"),
        ("{[1]: 2}", "plain word"),
        ("? {a: 1}\n: 2", "plain word"),
        ("a: !!python/object:os.system x", "line 1"),
        ("a: [1, 2", "line"),
        ("\tb: 1", "line 1"),
        ("a: &a {b: 1}\nc:\n  <<: *a\n", "line 3, column 3: merge keys"),
    ],
)
def test_what_nobody_means_is_refused_with_its_line(text, says):
    with pytest.raises(DocumentError, match=says.replace("[", r"\[")):
        parse_yaml(text)


@given(plain)
def test_json_reads_back_the_same(value):
    assert parse_json(json.dumps(value)) == value


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ('[{"pan_deg": 1, "pan_deg": 2}]', "key 'pan_deg' is given twice"),
        ("[1,", "not JSON"),
        ("9" * 5000, "not JSON"),
        ("[" * 100_000, "not JSON"),
    ],
)
def test_json_that_nobody_means_is_refused(text, says):
    with pytest.raises(DocumentError, match=says):
        parse_json(text)


@pytest.mark.parametrize("text", ["a: 2024-13-45", "a: 2024-01-01", "a: 2001-12-14t21:59:43.10-05:00"])
def test_a_date_is_a_text(text):
    assert parse_mapping(text)["a"] == text[3:]


@pytest.mark.parametrize("text", ["22:00", "6:30", "190:20:30.15", "-1:00"])
def test_a_time_of_day_is_a_text(text):
    assert parse_yaml(f"from: {text}") == {"from": text}


def test_a_number_may_be_written_as_in_yaml_1_2():
    assert parse_mapping("a: 1e-3\nb: .inf\nc: 0x1F") == {"a": 0.001, "b": float("inf"), "c": 31}


def test_a_document_that_is_no_mapping_says_what_it_is():
    with pytest.raises(DocumentError, match="holds list, no mapping"):
        parse_mapping("[1]")


readers = pytest.mark.parametrize(
    "read",
    [
        read_text,
        read_regular,
        lambda path: RecordFile(path).__enter__(),
        read_grey,
        read_source,
        read_picture,
        recover,
        simulate._password,
        lambda path: _read(path, 1),
        lambda path: read_credentials("ptzd", str(path), setting="ptz"),
    ],
)


@readers
@pytest.mark.parametrize("make", [Path.mkdir, lambda path: path.symlink_to("/dev/zero")], ids=["directory", "device"])
def test_so_is_a_directory_or_a_device(tmp_path, read, make):
    make(tmp_path / "settings")
    with pytest.raises((OSError, PtzdError), match=r"no regular file|Is a directory|is a link"):
        read(tmp_path / "settings")


@readers
def test_a_pipe_where_a_file_was_named_is_refused_and_waited_for_by_nobody(tmp_path, read):
    pipe = tmp_path / "settings"
    os.mkfifo(pipe)
    with pytest.raises((OSError, PtzdError), match="no regular file"):
        read(pipe)


def test_a_file_beyond_all_measure_is_not_read(tmp_path):
    path = tmp_path / "x.yaml"
    path.write_bytes(b"a" * (LARGEST_BYTES + 1))
    with pytest.raises(DocumentError, match="right file"):
        read_text(path)
    path.write_bytes(b"a: \xff")
    with pytest.raises(DocumentError, match="no UTF-8 text, at byte 3"):
        read_text(path)


def numbers(kind: type[msgspec.Struct], head: tuple[str, ...] = ()) -> list[tuple[str, ...]]:
    """Where a settings file may hold one number."""
    found = []
    for field in msgspec.structs.fields(kind):
        inner = field.type
        if isinstance(inner, type) and issubclass(inner, msgspec.Struct):
            found += numbers(inner, (*head, field.name))
        elif isinstance(field.default, int | float) and not isinstance(field.default, bool):
            found.append((*head, field.name))
    return found


BASE = {
    "rig": "hall",
    "calibration": "rig.yaml",
    "fisheye": {"source": "http", "url": "http://192.0.2.1/"},
    "ptz": {"url": "http://192.0.2.2", "user": "u"},
}


@pytest.mark.parametrize("path", numbers(Config), ids=".".join)
@pytest.mark.parametrize("value", [float("inf"), float("-inf"), float("nan"), 1e300, -1e300, 10**40])
def test_no_number_of_the_settings_is_without_a_bound(path, value):
    document = msgspec.to_builtins(BASE)
    part = document
    for name in path[:-1]:
        part = part.setdefault(name, {})
    part[path[-1]] = value
    with pytest.raises(ConfigError, match=path[-1]):
        parse_config(document, "ptzd.yaml")


def test_only_the_far_end_of_the_search_may_be_infinite():
    assert parse_config(BASE | {"search": {"range_m": [1.0, float("inf")]}}, "x").search.range_m[1] == float("inf")
    for range_m in ([float("inf"), 2.0], [1.0, float("-inf")]):
        with pytest.raises(ConfigError, match="range_m"):
            parse_config(BASE | {"search": {"range_m": range_m}}, "x")
    for range_m in ([1e-9, 2.0], [1.0, 2e6]):
        with pytest.raises(ConfigError, match="is beyond"):
            parse_config(BASE | {"search": {"range_m": range_m}}, "x")


@pytest.mark.parametrize("text", ["rig: a\nrig: b", "rig: &a [*a]", "rig: " + "[" * 99, "rig: " + "9" * 5000])
def test_settings_and_calibration_go_through_the_same_loader(tmp_path, text):
    path = tmp_path / "ptzd.yaml"
    path.write_text(text)
    with pytest.raises(ConfigError, match=r"ptzd\.yaml: line 1|ptzd\.yaml: line 2"):
        load(path)


def test_what_the_daemon_keeps_beside_its_log_is_not_waited_for_either(tmp_path):
    settings = {"rig": "hall", "calibration": "rig.yaml", "fisheye": {"source": "files", "path": "pictures"},
                "ptz": {"url": "http://192.0.2.20", "user": "ptzd"}, "log": {"directory": str(tmp_path)}}  # fmt: skip
    config, digest = parse_config(settings, "ptzd.yaml"), "0" * 64
    for path in (motor_file.motor_path(config), ranges_file.ranges_path(config, digest)):
        os.mkfifo(path)
    assert motor_file.read_travel(motor_file.motor_path(config)) == Travel()
    assert ranges_file.read_ranges(config, digest, 1) == RangeMap()


def test_a_password_may_come_from_a_command_of_the_shell():
    """``ptzd sim --password-file <(pass show camera)``: read once, and by whoever typed it."""
    ours, theirs = os.pipe()
    os.write(theirs, b"swordfish\nmore\n")
    os.close(theirs)
    try:
        assert simulate._password(Path(f"/dev/fd/{ours}")) == "swordfish"
    finally:
        os.close(ours)
