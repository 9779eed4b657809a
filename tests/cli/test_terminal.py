"""What comes from outside never steers the terminal, whichever way it gets there."""

from __future__ import annotations

import io
import json
import logging
import re
import unicodedata

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ptzd.app.journal import OneLine
from ptzd.cli import entry, terminal
from ptzd.plain import plain, plain_lines

NASTY = "\x1b]0;title\x07\x1b[2J\x1b[31m\rERROR\x9b31m\x7f\u202eabc\u2028\ud800\x00"


def harmless(text: str, allowed: str = "") -> bool:
    return not [c for c in text if c not in allowed and unicodedata.category(c) in {"Cc", "Cs", "Zl", "Zp"}]


@given(st.text())
def test_any_text_becomes_one_harmless_line_and_ordinary_text_stays(text: str) -> None:
    shown = plain(text)
    assert harmless(shown, "\t")
    shown.encode()
    assert harmless(plain_lines(text), "\t\n")
    if text.isprintable():
        assert shown == plain_lines(text) == text


@given(st.text(st.characters(exclude_categories=("Cs",))))
def test_json_stays_the_same_document(text: str) -> None:
    document = msgspec.json.encode({"reason": text}).decode()
    assert json.loads(plain_lines(document)) == {"reason": text}


def test_everything_printed_is_plain(monkeypatch) -> None:
    out = io.StringIO()
    monkeypatch.setattr("sys.stdout", out)
    with terminal.plain_output():
        print(NASTY, "next", sep="\n")
    assert harmless(out.getvalue(), "\n")
    assert out.getvalue().endswith("\nnext\n")


@pytest.mark.parametrize(
    "arguments",
    [
        [NASTY],
        ["aim", NASTY],
        ["aim", "1,2,30,40", "--id", NASTY],
        ["cancel", NASTY, "--connect", "tcp/127.0.0.1:1"],
        ["status", "--connect", NASTY],
        ["check", "--config", "no\x1b[31mfile"],
        ["replay", "no\x1b[31mfile"],
        ["log", "info", "no\x1b[31mfile"],
        ["schema", NASTY],
        ["calibrate", "rig", "no\x1b[31mfile", "--work", "w"],
    ],
)
def test_no_command_repeats_what_it_was_given_raw(arguments: list[str], capsys, tmp_path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    try:
        code = entry(arguments)
    except SystemExit as end:
        code = end.code
    told = capsys.readouterr()
    assert code not in (0, 70), told.err
    assert harmless(told.out + told.err, "\n\t")
    assert "Traceback" not in told.err


def test_the_journal_s_line_is_one_and_plain() -> None:
    record = logging.LogRecord("ptzd", logging.WARNING, "a.py", 1, "refused: %s", (f"{NASTY}\nERROR ptzd: fake",), None)
    line = OneLine("%(message)s").format(record)
    assert harmless(line)
    assert re.match(r"refused: \\u001b\]0;title", line)
