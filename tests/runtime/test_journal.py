from __future__ import annotations

import logging
import os
import socket
from contextlib import closing

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ptzd.runtime.journal import JournalHandler, encode, goes_to_journal


def decode(message):
    """The protocol read as its description says."""
    fields = {}
    while message:
        line, _, rest = message.partition(b"\n")
        if b"=" in line:
            key, _, value = line.partition(b"=")
        else:
            key, length = line, int.from_bytes(rest[:8], "little")
            value, rest = rest[8 : 8 + length], rest[8 + length + 1 :]
        fields[key.decode()] = value.decode()
        message = rest
    return fields


class Kept(logging.Handler):
    def __init__(self):
        super().__init__()
        self.records = []

    def emit(self, record):
        self.records.append(record)


@pytest.fixture
def journal(tmp_path):
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK) as listening:
        listening.bind(str(tmp_path / "socket"))
        yield listening


@pytest.fixture
def fallback():
    return Kept()


@pytest.fixture
def logger(tmp_path, fallback):
    made = logging.getLogger("ptzd.test")
    made.setLevel(logging.DEBUG)
    with closing(JournalHandler(fallback, tmp_path / "socket")) as handler:
        made.addHandler(handler)
        yield made
        made.removeHandler(handler)


@given(
    st.dictionaries(
        st.from_regex(r"[A-Z][A-Z_]{0,10}", fullmatch=True),
        st.text(st.characters(exclude_categories=["Cs"]), max_size=40),
    )
)
def test_what_is_encoded_reads_back(fields):
    assert decode(encode(fields)) == fields


def test_messages_can_be_found_by_request(logger, journal):
    logger.warning("lost %s", "sight", extra={"request": "gate-3", "rig": "yard"})
    fields = decode(journal.recv(4096))
    assert (fields["MESSAGE"], fields["PRIORITY"], fields["LOGGER"]) == ("lost sight", "4", "ptzd.test")
    assert (fields["PTZD_REQUEST"], fields["PTZD_RIG"]) == ("gate-3", "yard")
    assert "PTZD_DEVICE" not in fields


@pytest.mark.parametrize(
    ("level", "priority"),
    [(logging.DEBUG, "7"), (logging.INFO, "6"), (logging.WARNING, "4"), (logging.ERROR, "3"), (logging.CRITICAL, "2")],
)
def test_levels_become_priorities(logger, journal, level, priority):
    logger.log(level, "x")
    assert decode(journal.recv(4096))["PRIORITY"] == priority


def test_a_message_of_several_lines_stays_one(logger, journal):
    logger.error("a\nPRIORITY=0\nb")
    fields = decode(journal.recv(4096))
    assert (fields["MESSAGE"], fields["PRIORITY"]) == ("a\nPRIORITY=0\nb", "3")


def test_what_the_journal_does_not_take_is_not_lost(logger, fallback, tmp_path):
    logger.warning("nobody listens")
    assert [record.getMessage() for record in fallback.records] == ["nobody listens"]


def test_a_full_journal_never_makes_the_daemon_wait(logger, journal, fallback):
    for _ in range(2000):
        logger.warning("x")
    assert fallback.records


def test_only_a_stream_that_is_the_journals_counts(tmp_path):
    with (tmp_path / "stream").open("w") as stream:
        facts = os.fstat(stream.fileno())
        ours = {"JOURNAL_STREAM": f"{facts.st_dev}:{facts.st_ino}"}
        assert goes_to_journal(ours, stream.fileno())
        assert not goes_to_journal({"JOURNAL_STREAM": f"{facts.st_dev}:1"}, stream.fileno())
        assert not goes_to_journal({}, stream.fileno())
        descriptor = stream.fileno()
    assert not goes_to_journal(ours, descriptor)
