"""Whatever the disk takes its time for, writing goes on; what it refuses is told, and nothing is lost by it."""

import asyncio
import errno
import os
import threading
from dataclasses import replace
from pathlib import Path

import pytest

from ptzd.control.events import DeadlinePassed, Snapshot
from ptzd.errors import LogError
from ptzd.log import file as file_module
from ptzd.log import retention, scribe
from ptzd.log.reader import LogReader
from ptzd.log.topics import FISHEYE_IMAGE
from ptzd.log.writer import McapLog
from tests.log.conftest import START_NS


async def until(condition, timeout_s=100.0):
    async with asyncio.timeout(timeout_s):
        while not condition():  # noqa: ASYNC110 - a thread has no event to wait for
            await asyncio.sleep(0.01)


def sequences(path, *, torn_ok=False):
    with LogReader(path, torn_ok=torn_ok) as reader:
        return [item.sequence for item in reader.decisions()]


async def settled_again_and_again(log):
    while True:
        await log.settled()


def said(paths):
    found = []
    for path in paths:
        with LogReader(path) as reader:
            found += [entry.data.decode() for entry in reader.entries(["/log"])]
    return "\n".join(found)


@pytest.fixture(autouse=True)
def quick(monkeypatch):
    monkeypatch.setattr(scribe, "SYNC_S", 0.02)
    monkeypatch.setattr(scribe, "CHUNK_S", 0.01)


@pytest.fixture
def asleep(monkeypatch):
    """A disk that confirms nothing before it is woken."""
    woken = threading.Event()
    for name in ("fsync", "fdatasync"):
        real = getattr(os, name)

        def wait(descriptor, real=real):
            woken.wait(100)
            real(descriptor)

        monkeypatch.setattr(file_module.os, name, wait)
    yield woken
    woken.set()


@pytest.fixture
def refusing(monkeypatch):
    """Makes one of the disk's calls fail once."""

    def refuse(name):
        real = getattr(os, name)
        left = [1]

        def once(descriptor):
            if left:
                left.pop()
                raise OSError(errno.EIO, os.strerror(errno.EIO))
            real(descriptor)

        monkeypatch.setattr(file_module.os, name, once)

    return refuse


async def test_a_sleeping_disk_holds_up_no_record(settings, run, clock, asleep, monkeypatch):
    monkeypatch.setattr(scribe, "LATE_SYNC_S", 0.05)
    async with McapLog(settings(rotate_s=1e-6), run, clock) as log:
        files = []
        for part in range(3):
            await until(log.rotate_due)
            log.rotate(2 * part, part, Snapshot())
            log.event(2 * part + 1, part, DeadlinePassed())
            await until(lambda: log.stats().waiting == 0)
            files.append(log.current_file)
            active = files[-1].with_name(f"{files[-1].name}.active")
            await until(lambda: len(sequences(active, torn_ok=True)) == 2)  # noqa: B023 - awaited within the turn
        assert log.closed_files() == []
        await until(lambda: "confirmed nothing" in log.stats().degraded)
        asleep.set()
        await until(lambda: not log.stats().degraded)
        await log.settled()
        assert log.closed_files() == files[:2]
    assert log.closed_files() == files
    assert [sequences(path) for path in files] == [[0, 1], [2, 3], [4, 5]]
    assert "confirmed nothing" in said(files)


async def test_a_file_that_the_disk_would_not_sync_is_given_up(settings, run, clock, refusing):
    async with McapLog(settings(), run, clock) as log:
        log.rotate(0, 0, Snapshot())
        await log.settled()
        first = log.current_file
        refusing("fdatasync")
        await until(lambda: log.current_file not in {None, first})
        await until(log.rotate_due)
        log.rotate(1, 1, Snapshot())
        await until(lambda: first in log.closed_files())
    assert [sequences(path) for path in log.closed_files()] == [[0], [1]]
    assert f"{first.name}: recovered" in said(log.closed_files())


async def test_a_file_that_cannot_be_closed_is_mended_and_told(settings, run, clock, refusing):
    async with McapLog(settings(rotate_s=1e-6), run, clock) as log:
        log.rotate(0, 0, Snapshot())
        await log.settled()
        first = log.current_file
        refusing("fsync")
        await until(log.rotate_due)
        log.rotate(1, 1, Snapshot())
        await until(lambda: first in log.closed_files())
    assert [sequences(path) for path in log.closed_files()] == [[0], [1]]
    told = said(log.closed_files())
    assert f"{first.name}.active: cannot be closed" in told
    assert f"{first.name}: recovered: whole" in told


async def test_old_files_go_when_they_are_old(settings, run, clock, snapshot):
    made = settings(keep_days=1.0)
    for _ in range(4):
        async with McapLog(made, run, clock) as log:
            log.rotate(0, START_NS, snapshot)
    for path, hours in zip(log.closed_files(), (48, 25, 13, 1), strict=True):
        then_s = clock.now_ns() / 1e9 - hours * 3600
        os.utime(path, (then_s, then_s))
    oldest, old, *young = log.closed_files()
    async with McapLog(made, run, clock) as log:
        log.rotate(0, START_NS, snapshot)
        assert not oldest.exists()
        assert not old.exists()
        assert all(path.exists() for path in young)
    told = said(log.closed_files())
    assert f"{oldest.name} (0 MB) deleted: older than log.keep_days, 1" in told


async def test_a_clock_far_ahead_deletes_nothing_by_age_and_says_so(settings, run, clock, snapshot):
    made = settings(keep_days=30.0)
    for _ in range(3):
        async with McapLog(made, run, clock) as log:
            log.rotate(0, START_NS, snapshot)
    before = log.closed_files()
    for number, path in enumerate(before):
        then_s = clock.now_ns() / 1e9 - 40 * 86_400 + number
        os.utime(path, (then_s, then_s))
    async with McapLog(made, run, clock) as log:
        log.rotate(0, START_NS, snapshot)
    assert all(path.exists() for path in before)
    assert "the clock is 40.0 days after the newest file of the log" in said(log.closed_files())


async def test_the_oldest_make_room_before_pictures_stop(settings, run, clock, snapshot, picture, monkeypatch):
    """Each closed file that goes gives a MiB back; two have to."""
    made = settings(min_free_bytes=100 << 20)
    for _ in range(4):
        async with McapLog(made, run, clock) as log:
            log.rotate(0, START_NS, snapshot)
    for number, path in enumerate(log.closed_files()):
        path.rename(path.with_name(f"yard-20200101T00000{number}Z-000.mcap"))
    before = log.closed_files()
    gone = lambda: sum(not path.exists() for path in before)  # noqa: E731
    monkeypatch.setattr(retention, "free_bytes", lambda directory: (98 + gone()) << 20)
    real = retention.closed_files
    monkeypatch.setattr(retention, "closed_files", lambda *of: [replace(stored, size=1 << 20) for stored in real(*of)])
    async with McapLog(made, run, clock) as log:
        assert gone() == 2, "before the first byte is written"
        log.picture(FISHEYE_IMAGE, picture(0))
        await log.settled()
        assert log.stats().pictures == 1
        assert log.stats().degraded == ""
    assert [path.exists() for path in before] == [False, False, True, True]


async def test_files_that_cannot_be_deleted_are_told(settings, run, clock, snapshot, picture, monkeypatch):
    def refuse(path, missing_ok=False):
        raise OSError(errno.EROFS, os.strerror(errno.EROFS))

    async with McapLog(settings(keep_bytes=1_000_000, rotate_s=1e-6), run, clock) as log:
        monkeypatch.setattr(Path, "unlink", refuse)
        for part in range(3):
            await until(log.rotate_due)
            log.rotate(part, START_NS, snapshot)
            log.picture(FISHEYE_IMAGE, picture(part, size=600_000))
        await until(lambda: log.rotate_due() and log.stats().messages > 6)
    monkeypatch.undo()
    assert "old files stay: Read-only file system" in said(log.closed_files())


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
async def test_a_defect_in_a_thread_of_the_log_is_heard_by_who_waits_and_who_writes(
    settings, run, clock, snapshot, monkeypatch
):
    def defect(*of):
        raise RuntimeError("a defect")

    async with McapLog(settings(), run, clock) as log:
        monkeypatch.setattr(retention, "closed_files", defect)
        log.rotate(0, START_NS, snapshot)
        with pytest.raises(LogError, match="writer has ended"):
            await settled_again_and_again(log)
        with pytest.raises(LogError, match="writer has ended"):
            log.event(1, 1, DeadlinePassed())
        assert log.stats().degraded == "the writer has ended"
