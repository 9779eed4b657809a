"""A torn file becomes a whole one with everything that was whole in it."""

import fcntl
import importlib.util
import os
import shutil
import sys
import time
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader

from ptzd.control.events import FrameArrived
from ptzd.errors import LogError
from ptzd.log.codec import encode
from ptzd.log.file import McapFile
from ptzd.log.protobuf import CompressedImage, encode_image
from ptzd.log.reader import LogReader
from ptzd.log.records import RecordFile
from ptzd.log.recover import recover, recover_directory
from ptzd.log.run_info import RunInfo
from ptzd.log.topics import EVENT, FISHEYE_IMAGE, TOPICS
from ptzd.model import FrameRef

T0 = 1_795_000_000_000_000_000
RUN = RunInfo(rig="yard", config_text="rig: yard\n", calibration_text="ptzd_calibration: 1\n")


def write(path, chunks=4, per_chunk=5):
    """A file with pictures and events in known chunks; returns the offset behind each chunk."""
    file = McapFile(path, RUN, T0)
    file.open()
    good = []
    for number in range(chunks * per_chunk):
        t_ns = T0 + number * 1_000_000
        frame = FrameRef(seq=number, t_capture_ns=t_ns)
        image = CompressedImage(t_ns=t_ns, frame_id="fisheye", data=os.urandom(300), format="jpeg")
        file.add(FISHEYE_IMAGE, t_ns + 1, t_ns, number, encode_image(image))
        name, body = encode(FrameArrived(frame=frame))
        document = f'{{"sequence":{number},"t_ns":{t_ns},"name":"{name}","body":{_quoted(body)}}}'
        file.add(EVENT, t_ns, t_ns, number, document.encode())
        if number % per_chunk == per_chunk - 1:
            file.flush()
            good.append(file.good)
    file.finish()
    return good


def _quoted(body):
    return '"' + body.decode().replace('"', '\\"') + '"'


def sequences(path):
    with LogReader(path) as log:
        return [item.sequence for item in log.decisions()]


def opens_everywhere(path):
    """The indexed reader of the mcap library and our own agree."""
    with path.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        summary = reader.get_summary()
        by_index = [message.sequence for _, channel, message in reader.iter_messages(topics=[EVENT])]
        counted = sum(1 for _ in reader.iter_messages())
    assert (summary.statistics.message_count if summary else 0) == counted
    assert by_index == sequences(path)
    return by_index


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    path = tmp_path_factory.mktemp("whole") / "yard.mcap"
    return path, write(path)


@pytest.mark.usefixtures("unsynced")
def test_every_cut_keeps_every_whole_chunk(whole, tmp_path, prompt_disk):
    path, _ = whole
    data = path.read_bytes()

    @settings(max_examples=80, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
    @given(st.integers(0, len(data) - 1))
    def run(cut):
        torn = tmp_path / "yard.mcap.active"
        torn.write_bytes(data[:cut])
        final = tmp_path / "yard.mcap"
        final.unlink(missing_ok=True)
        if cut < 8:
            with pytest.raises(LogError, match="not an MCAP file"):
                recover(torn)
            return
        report = recover(torn)
        for aside in tmp_path.glob("*.cut"):
            assert data[:cut].endswith(aside.read_bytes())
            assert report.messages == 0, "only descriptions that nothing follows"
            aside.unlink()
        assert report.path == final
        assert not torn.exists()
        assert report.bytes_kept + report.bytes_cut == cut
        whole_chunks = sum(1 for end in _chunk_ends(path) if end <= cut)
        assert report.messages == whole_chunks * 10
        if whole_chunks:
            assert opens_everywhere(final) == list(range(whole_chunks * 5))
        assert recover(final).note == "whole"

    run()


def _chunk_ends(path):
    with RecordFile(path) as file:
        return [frame.end for frame in file.frames() if frame.opcode == 6]


def test_a_whole_file_stays_as_it_is(whole, tmp_path):
    path, _ = whole
    copy = tmp_path / "yard.mcap.active"
    shutil.copy(path, copy)
    report = recover(copy)
    assert report.note == "whole"
    assert report.path.read_bytes() == path.read_bytes()


def test_a_chunk_with_a_wrong_checksum_is_passed_over(whole, tmp_path):
    path, _ = whole
    data = bytearray(path.read_bytes())
    ends = _chunk_ends(path)
    data[ends[1] - 50] ^= 0x40
    torn = tmp_path / "yard.mcap"
    torn.write_bytes(data)
    with pytest.raises(LogError, match="checksum"):
        sequences(torn)
    report = recover(torn)
    assert report.parts_lost == 1
    assert "1 damaged parts passed over" in report.note
    assert opens_everywhere(torn) == [*range(5), *range(10, 20)]


def test_a_file_whose_first_chunk_is_gone_still_knows_its_topics(whole, tmp_path):
    path, _ = whole
    data = bytearray(path.read_bytes())
    with RecordFile(path) as file:
        first = next(frame for frame in file.frames() if frame.opcode == 6)
    data[first.body + 60 : first.end - 60] = bytes(first.length - 120)
    torn = tmp_path / "yard.mcap.active"
    torn.write_bytes(data[: -len(data) // 50])
    report = recover(torn)
    assert report.parts_lost == 1
    assert opens_everywhere(report.path) == list(range(5, 20))
    with LogReader(report.path) as log:
        assert {entry.topic for entry in log.entries()} == {EVENT, FISHEYE_IMAGE}
    with report.path.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert {channel.topic for channel in summary.channels.values()} == set(TOPICS)


def test_message_indexes_behind_a_damaged_chunk_belong_to_no_other(whole, tmp_path):
    """A viewer that jumps by index must not land in what was damaged."""
    path, _ = whole
    data = bytearray(path.read_bytes())
    data[_chunk_ends(path)[1] - 50] ^= 0x40
    torn = tmp_path / "yard.mcap"
    torn.write_bytes(data)
    recover(torn)
    with torn.open("rb") as stream:
        chunks = make_reader(stream).get_summary().chunk_indexes
    with RecordFile(torn) as file:
        for chunk in chunks:
            behind = chunk.chunk_start_offset + chunk.chunk_length
            assert min(chunk.message_index_offsets.values()) == behind
            frames = [f for f in file.frames() if behind <= f.start < behind + chunk.message_index_length]
            assert [f.opcode for f in frames] == [7] * len(chunk.message_index_offsets)


@pytest.mark.parametrize("opcode", [2, 15])
@pytest.mark.parametrize("which", [6, 4, 3])
def test_a_record_that_damage_turned_into_an_end_ends_nothing(whole, tmp_path, which, opcode):
    """One byte makes a chunk, a channel or a schema look like the footer or the end of data: the rest is kept."""
    path, _ = whole
    data = bytearray(path.read_bytes())
    with RecordFile(path) as file:
        start = [frame.start for frame in file.frames() if frame.opcode == which][1]
    data[start] = opcode
    torn = tmp_path / "yard.mcap"
    torn.write_bytes(data)
    report = recover(torn)
    assert report.parts_lost == 1
    expected = [*range(5), *range(10, 20)] if which == 6 else list(range(20))
    assert opens_everywhere(torn) == expected
    assert recover(torn).note == "whole"


def test_a_footer_before_the_end_of_data_ends_nothing(whole, tmp_path):
    path, _ = whole
    data = path.read_bytes()
    end = _chunk_ends(path)[1]
    torn = tmp_path / "yard.mcap"
    torn.write_bytes(data[:end] + b"\x02" + (20).to_bytes(8, "little") + bytes(20) + data[end:])
    assert recover(torn).parts_lost == 1
    assert opens_everywhere(torn) == list(range(20))


def test_a_file_in_use_is_left_alone(whole, tmp_path):
    path, _ = whole
    active = tmp_path / "yard.mcap.active"
    active.write_bytes(path.read_bytes()[:-30])
    with active.open("rb") as holder:
        fcntl.flock(holder, fcntl.LOCK_EX)
        with pytest.raises(LogError, match="being written by a running daemon"):
            recover(active)
        assert "running daemon" in recover_directory(tmp_path)[0]
        assert active.exists()
    assert "recovered" in recover_directory(tmp_path)[0]


def test_a_directory_after_a_crash(whole, tmp_path):
    path, _ = whole
    (tmp_path / "empty.mcap.active").write_bytes(b"")
    (tmp_path / "torn.mcap.active").write_bytes(path.read_bytes()[:-200])
    (tmp_path / "junk.mcap.active").write_bytes(b"hello, this is not a log")
    (tmp_path / "twice.mcap.active").write_bytes(path.read_bytes()[:-200])
    shutil.copy(path, tmp_path / "twice.mcap")
    lines = recover_directory(tmp_path)
    assert [line.split(": ")[0].rpartition("/")[2] for line in lines] == [
        "empty.mcap.active",
        "junk.mcap.active",
        "torn.mcap",
        "twice.mcap.active",
    ]
    assert "removed" in lines[0]
    assert "not an MCAP file" in lines[1]
    assert "40 messages kept" in lines[2]
    assert "exists as well" in lines[3]
    assert sequences(tmp_path / "torn.mcap") == list(range(20))


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(LogError, match=r"nothing\.mcap: cannot be opened"):
        recover(tmp_path / "nothing.mcap")


def test_recovery_needs_little_room(whole, tmp_path):
    """The closing summary is all that is written."""
    path, good = whole
    torn = tmp_path / "torn.mcap"
    torn.write_bytes(path.read_bytes()[: good[-1] + 3])
    before = torn.read_bytes()
    recover(torn)
    after = torn.read_bytes()
    chunk_end = _chunk_ends(path)[-1]
    assert after[:chunk_end] == before[:chunk_end]


@pytest.fixture(scope="module")
def kills():
    """The bench that kills busy writers."""
    path = Path(__file__).parents[1] / "bench" / "kills.py"
    spec = importlib.util.spec_from_file_location("kills", path)
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("round_", range(int(os.environ.get("PTZD_KILLS", "4"))))
def test_kill_loses_less_than_half_a_second(tmp_path, kills, round_):
    """However slow the disk: what the kernel was given outlives the process."""
    sync_s = kills.SLOW_SYNC_S if round_ % 2 else 0.0
    found = kills.kill(tmp_path / "log", 0.4 + 0.37 * (round_ % 5) + 0.011 * round_, sync_s)
    assert all("recovered" in note or "removed" in note for note in found.notes), found.notes
    assert found.in_order
    assert found.told_ns
    assert found.lost_s - found.held_up_s <= 0.5


@pytest.mark.bench
def test_recovery_reads_fast(tmp_path):
    """Prints the rate on this machine; asserts only that a GiB would not hold up a start."""
    path = tmp_path / "yard.mcap"
    file = McapFile(path, RUN, T0)
    file.open()
    picture = encode_image(CompressedImage(t_ns=T0, frame_id="fisheye", data=os.urandom(300_000), format="jpeg"))
    for number in range(300):
        file.add(FISHEYE_IMAGE, T0 + number, T0 + number, number, picture)
    file.flush()
    file.abandon()
    active = Path(f"{path}.active")
    size = active.stat().st_size
    begin, begin_cpu = time.perf_counter(), time.process_time()
    report = recover(active)
    seconds, seconds_cpu = time.perf_counter() - begin, time.process_time() - begin_cpu
    print(f"recovered {size / 1e6:.0f} MB at {size / 1e6 / seconds:.0f} MB/s")
    assert report.messages == 300
    assert size / seconds_cpu > 50e6, "what it costs the processor, whatever the disk"


def test_links_are_not_followed(tmp_path):
    elsewhere = tmp_path / "elsewhere.bin"
    elsewhere.write_bytes(b"somebody else's data, longer than a head of a record")
    folder = tmp_path / "log"
    folder.mkdir()
    link = folder / "yard-20261121T231502Z-000.mcap.active"
    link.symlink_to(elsewhere)
    with pytest.raises(LogError, match="is a link"):
        recover(link)
    assert recover_directory(folder) == [f"{link.name}: no file of its own; left alone"]
    assert elsewhere.read_bytes().startswith(b"somebody")
