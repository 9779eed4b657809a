"""What goes into the black box comes out of it, in order, whatever is asked of it meanwhile."""

import asyncio
from pathlib import Path

import pytest
from mcap.reader import make_reader

from ptzd.control.commands import MoveHead, PinFrame, ReleaseFrames, RunMatch, StopHead
from ptzd.control.events import MatchFailed, Snapshot, ViewTaken
from ptzd.errors import LogError
from ptzd.log.reader import LoggedCommand, LoggedEvent, LogReader
from ptzd.log.topics import FISHEYE_IMAGE, IMAGES, PTZ_IMAGE
from ptzd.log.writer import McapLog
from ptzd.model import Box, FrameRef, HeadReading, Matcher, ViewRef
from tests.log.conftest import START_NS

READING = HeadReading(pan_deg=1.25, tilt_deg=-3.5, zoom=1.0)
PATIENCE_S = 100.0
"""For anything that must happen: a slow disk is no failure."""


def decisions(path):
    with LogReader(path) as log:
        return list(log.decisions())


def pictures(path):
    with LogReader(path) as log:
        return [(entry.topic, entry.sequence) for entry in log.entries(IMAGES)]


async def until(condition):
    """Wait for what the writer's thread is about to do."""
    while not condition():  # noqa: ASYNC110 - a thread has no event to wait for
        await asyncio.sleep(0.01)


async def test_decisions_and_pictures_come_back(settings, run, clock, picture, frames, snapshot):
    move = MoveHead(move_id=3, target=READING)
    async with McapLog(settings(), run, clock) as log:
        log.rotate(0, START_NS, snapshot)
        log.picture(FISHEYE_IMAGE, picture(0))
        t_ns, arrived = next(frames)
        log.event(1, t_ns, arrived)
        log.command(1, t_ns, move)
        log.picture(PTZ_IMAGE, picture(4))
        path = log.current_file
    assert decisions(path) == [
        LoggedEvent(sequence=0, t_ns=START_NS, event=snapshot),
        LoggedEvent(sequence=1, t_ns=t_ns, event=arrived),
        LoggedCommand(sequence=1, t_ns=t_ns, command=move),
    ]
    with LogReader(path) as reader:
        assert reader.run == run
        assert reader.picture(FISHEYE_IMAGE, picture(0).frame) == picture(0).jpeg
        assert reader.picture(PTZ_IMAGE, picture(4).frame) == picture(4).jpeg
        with pytest.raises(LogError, match="no picture 9"):
            reader.picture(PTZ_IMAGE, picture(9).frame)
    assert path.name.startswith("yard-2026")
    assert path.name.endswith("Z-000.mcap")
    assert [item.name for item in path.parent.iterdir()] == [path.name]


async def test_times_are_those_of_decision_and_capture(settings, run, clock, picture):
    async with McapLog(settings(), run, clock) as log:
        log.picture(FISHEYE_IMAGE, picture(3))
        path = log.current_file
    with LogReader(path) as reader:
        (entry,) = reader.entries([FISHEYE_IMAGE])
    assert entry.publish_ns == picture(3).frame.t_capture_ns
    assert entry.log_ns == picture(3).t_arrival_ns
    assert entry.sequence == 3


async def test_the_usual_reader_opens_a_closed_file(settings, run, clock, picture, frames, snapshot):
    async with McapLog(settings(), run, clock) as log:
        log.rotate(0, START_NS, snapshot)
        for seq in range(20):
            log.picture(FISHEYE_IMAGE, picture(seq, size=200_000))
            log.event(seq + 1, *next(frames))
        path = log.current_file
    with path.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        summary = reader.get_summary()
        assert summary.statistics.message_count == 41
        assert reader.get_header().profile == ""
        assert reader.get_header().library.startswith("ptzd ")
        assert [record.name for record in reader.iter_metadata()] == ["ptzd.run"]
        assert [record.name for record in reader.iter_attachments()] == ["config.yaml", "rig.yaml"]
        assert len(list(reader.iter_messages())) == 41
        assert {index.compression for index in summary.chunk_indexes} == {""}


async def test_slow_records_are_readable_before_the_file_ends(settings, run, clock, frames, snapshot):
    async with McapLog(settings(), run, clock) as log:
        log.rotate(0, START_NS, snapshot)
        log.event(1, *next(frames))
        active = log.current_file.with_name(log.current_file.name + ".active")

        def readable():
            with LogReader(active, torn_ok=True) as reader:
                return len(list(reader.decisions()))

        async with asyncio.timeout(PATIENCE_S):
            await until(lambda: readable() == 2)
        assert log.current_file.exists() is False


async def test_a_cut_lies_between_two_sequence_numbers(settings, run, clock, picture, frames, snapshot):
    async with McapLog(settings(rotate_s=1e-6), run, clock) as log:
        sequence = 0
        for part in range(3):
            async with asyncio.timeout(PATIENCE_S):
                await until(log.rotate_due)
            log.rotate(sequence, START_NS + sequence, Snapshot(state={"part": part}))
            assert not log.rotate_due()
            for _ in range(5):
                sequence += 1
                log.picture(FISHEYE_IMAGE, picture(sequence))
                log.event(sequence, *next(frames))
                log.command(sequence, START_NS, StopHead())
    files = log.closed_files()
    assert [path.name[-8:] for path in files] == ["000.mcap", "001.mcap", "002.mcap"]
    for part, path in enumerate(files):
        found = decisions(path)
        assert found[0].event.state == {"part": part}
        expected = [part * 5, *(number for number in range(part * 5 + 1, part * 5 + 6) for _ in range(2))]
        assert [item.sequence for item in found] == expected
        with LogReader(path) as reader:
            assert reader.run.file_index == part


async def test_a_first_file_waits_for_its_snapshot(settings, run, clock, frames, snapshot):
    async with McapLog(settings(), run, clock) as log:
        assert log.rotate_due()
        log.rotate(0, START_NS, snapshot)
        async with asyncio.timeout(PATIENCE_S):
            await until(lambda: log.stats().messages == 1)
        assert not log.rotate_due()
    assert len(log.closed_files()) == 1


async def test_a_file_is_due_when_it_is_large(settings, run, clock, picture, snapshot):
    async with McapLog(settings(rotate_bytes=1_000_000), run, clock) as log:
        log.rotate(0, START_NS, snapshot)
        async with asyncio.timeout(PATIENCE_S):
            for seq in range(6):
                assert not log.rotate_due() or seq in {0, 5}
                log.picture(FISHEYE_IMAGE, picture(seq, size=200_000))
                await until(lambda: log.stats().waiting == 0)
            await until(log.rotate_due)


@pytest.mark.parametrize("used", ["pin before", "pin after"])
async def test_a_frame_that_a_request_used_is_there_though_it_was_skipped(settings, run, clock, picture, used):
    pin = PinFrame(request_id="a", frame=picture(7).frame)
    async with McapLog(settings(fisheye_every_n=5), run, clock) as log:
        if used == "pin before":
            log.command(1, clock.now_ns(), pin)
        for seq in range(11):
            log.picture(FISHEYE_IMAGE, picture(seq))
        if used == "pin after":
            log.command(1, clock.now_ns(), pin)
            log.command(2, clock.now_ns(), pin)
        assert log.stats().pictures_skipped == (7 if used == "pin before" else 8)
        path = log.current_file
    assert sorted(seq for _, seq in pictures(path)) == [0, 5, 7, 10]
    with LogReader(path) as reader:
        assert reader.picture(FISHEYE_IMAGE, picture(7).frame) == picture(7).jpeg
        entry = next(entry for entry in reader.entries(IMAGES) if entry.sequence == 7)
        assert (entry.log_ns, entry.publish_ns) == (picture(7).t_arrival_ns, picture(7).frame.t_capture_ns)


async def test_a_view_that_found_no_room_in_the_queue_is_written_late(settings, run, clock, picture):
    log = McapLog(settings(queue_frames=1), run, clock)
    async with log:
        seq = 0
        while not log.stats().pictures_dropped:
            log.picture(PTZ_IMAGE, picture(seq, size=500_000))
            seq += 1
        lost = picture(seq - 1)
        view = ViewRef(frame=lost.frame, reading=READING, sigma_deg=0.1)
        log.event(1, clock.now_ns(), ViewTaken(grab_id=1, view=view))
        path = log.current_file
    assert (PTZ_IMAGE, lost.frame.seq) in pictures(path)


async def test_decisions_are_never_dropped(settings, run, clock, picture, frames):
    async with McapLog(settings(queue_frames=1), run, clock) as log:
        for seq in range(400):
            log.event(seq, *next(frames))
            log.picture(FISHEYE_IMAGE, picture(seq, size=30_000))
        path = log.current_file
    stats = log.stats()
    assert [item.sequence for item in decisions(path)] == list(range(400))
    assert stats.pictures + stats.pictures_dropped == 400
    assert stats.decisions_lost == 0
    with LogReader(path) as reader:
        for entry in reader.entries(IMAGES):
            assert picture(entry.sequence, size=30_000).jpeg in entry.data


async def test_the_same_picture_twice_is_written_once(settings, run, clock, picture):
    async with McapLog(settings(), run, clock) as log:
        log.picture(PTZ_IMAGE, picture(1))
        log.picture(PTZ_IMAGE, picture(1))
        path = log.current_file
    assert pictures(path) == [(PTZ_IMAGE, 1)]


async def test_documents_of_other_topics(settings, run, clock):
    async with McapLog(settings(), run, clock) as log:
        log.document("/pose", 5, {"pan_deg": 1.5, "hfov_deg": None})
        with pytest.raises(LogError, match="/dreams: no topic"):
            log.document("/dreams", 5, {})
        with pytest.raises(LogError, match="takes pictures"):
            log.document(PTZ_IMAGE, 5, {})
        with pytest.raises(LogError, match="a time outside"):
            log.document("/pose", -1, {})
        path = log.current_file
    with LogReader(path) as reader:
        (entry,) = reader.entries(["/pose"])
    assert entry.data == b'{"pan_deg":1.5}'


async def test_a_picture_of_no_topic_is_refused(settings, run, clock, picture):
    async with McapLog(settings(), run, clock) as log:
        with pytest.raises(LogError, match="/event: no topic of pictures"):
            log.picture("/event", picture(0))


async def test_a_directory_that_cannot_be_used(settings, run, clock, tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(LogError, match=r"log\.directory"):
        async with McapLog(settings(directory=str(tmp_path / "file")), run, clock):
            pass


async def test_two_files_of_one_second_do_not_meet(settings, run, clock, frames):
    for _ in range(2):
        async with McapLog(settings(), run, clock) as log:
            log.event(0, *next(frames))
    names = [path.name for path in log.closed_files()]
    assert len(names) == len(set(names)) == 2


async def test_old_files_go(settings, run, clock, picture, snapshot):
    made = settings(keep_bytes=1_000_000, rotate_s=1e-6)
    async with McapLog(made, run, clock) as log:
        stranger = Path(made.directory) / "holiday.mcap"
        stranger.write_bytes(b"x" * 2_000_000)
        for part in range(5):
            async with asyncio.timeout(PATIENCE_S):
                await until(log.rotate_due)
            log.rotate(part, START_NS, snapshot)
            log.picture(PTZ_IMAGE, picture(part, size=600_000))
    names = [path.name[-8:-5] for path in log.closed_files()]
    assert names[-1] == "004"
    assert len(names) <= 2
    assert stranger.exists()


async def test_the_writer_says_when_it_has_ended(settings, run, clock, frames):
    log = McapLog(settings(), run, clock)
    async with log:
        pass
    assert log.stats().degraded == "the writer has ended"
    with pytest.raises(LogError, match="writer has ended"):
        log.event(1, *next(frames))


def test_frames_are_named_by_number_and_time(picture):
    one, other = picture(1), picture(1, t_ns=5)
    assert one.frame != other.frame
    assert one.frame == FrameRef(seq=1, t_capture_ns=one.frame.t_capture_ns)


def run_match(picture, number, view):
    return RunMatch(
        match_id=number,
        request_id="a",
        frame=picture(1).frame,
        box=Box(x=1.0, y=1.0, w=20.0, h=20.0),
        view=ViewRef(frame=view.frame, reading=READING, sigma_deg=0.1),
        inverse_range=(0.1, 1.0),
        band_rad=0.01,
        matcher=Matcher.SWEEP,
        seed=1,
    )


async def test_a_file_that_begins_in_the_middle_of_a_request_has_its_pictures(settings, run, clock, picture, snapshot):
    """The frame while the request lasts, a view while its match is under way, one that is used later at once."""
    views = [picture(seq, t_ns=START_NS + seq) for seq in (70, 71)]
    async with McapLog(settings(rotate_s=1e-6), run, clock) as log:
        sequence = 0

        async def cut():
            async with asyncio.timeout(PATIENCE_S):
                await until(log.rotate_due)
            log.rotate(sequence, START_NS, snapshot)

        await cut()
        log.picture(FISHEYE_IMAGE, picture(1))
        log.command(1, START_NS, PinFrame(request_id="a", frame=picture(1).frame))
        log.picture(PTZ_IMAGE, views[0])
        log.command(2, START_NS, run_match(picture, 1, views[0]))
        await cut()
        log.event(3, START_NS, MatchFailed(match_id=1, reason="none"))
        log.picture(PTZ_IMAGE, views[1])
        await cut()
        log.command(4, START_NS, run_match(picture, 2, views[1]))
        log.command(5, START_NS, ReleaseFrames(request_id="a"))
        log.event(6, START_NS, MatchFailed(match_id=2, reason="none"))
        await cut()
    assert [sorted(seq for _, seq in pictures(path)) for path in log.closed_files()] == [
        [1, 70],
        [1, 70, 71],
        [1, 71],
        [],
    ]


async def test_one_cut_at_a_time(settings, run, clock, picture, frames):
    """Asked between any two events, as the pump does, the log never begins a file before the last one is full."""
    sequence, rotations, full_bytes = 0, 0, 1_000_000
    async with McapLog(settings(rotate_bytes=full_bytes), run, clock) as log:
        while rotations < 8:
            if log.rotate_due():
                log.rotate(sequence, sequence, Snapshot())
                rotations += 1
            else:
                log.picture(FISHEYE_IMAGE, picture(sequence, size=20_000))
                log.event(sequence, *next(frames))
            sequence += 1
            if log.stats().waiting > 50:
                await log.settled()
    files = log.closed_files()
    assert len(files) == rotations
    assert all(path.stat().st_size >= full_bytes for path in files[:-1])
    assert [item.sequence for path in files for item in decisions(path)] == list(range(sequence))
