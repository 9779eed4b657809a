"""Whatever a file holds, reading it ends soon: with its content or with one clear line."""

import os
import random
import resource
import struct

import pytest
from mcap.opcode import Opcode
from mcap.writer import CompressionType, IndexType, Writer

from ptzd.control.events import DeadlinePassed, FrameArrived
from ptzd.errors import LogError
from ptzd.log.codec import encode
from ptzd.log.file import McapFile
from ptzd.log.protobuf import CompressedImage, encode_image
from ptzd.log.reader import LogReader
from ptzd.log.records import MAGIC, RecordFile, Torn, inner_frames
from ptzd.log.recover import recover
from ptzd.log.topics import EVENT, FISHEYE_IMAGE
from ptzd.model import FrameRef

T0 = 1_795_000_000_000_000_000
CASES = int(os.environ.get("PTZD_FUZZ", "150"))


def event_document(sequence, t_ns):
    name, body = encode(FrameArrived(frame=FrameRef(seq=sequence, t_capture_ns=t_ns)))
    quoted = body.decode().replace('"', '\\"')
    return f'{{"sequence":{sequence},"t_ns":{t_ns},"name":"{name}","body":"{quoted}"}}'.encode()


def image(number):
    return encode_image(
        CompressedImage(t_ns=T0 + number, frame_id="fisheye", data=bytes([number]) * 200, format="jpeg")
    )


@pytest.fixture
def small(tmp_path, run):
    """A file of a few chunks."""
    file = McapFile(tmp_path / "small.mcap", run, T0)
    file.open()
    for number in range(12):
        file.add(FISHEYE_IMAGE, T0 + number, T0 + number, number, image(number))
        file.add(EVENT, T0 + number, T0 + number, number, event_document(number, T0 + number))
        if number % 4 == 3:
            file.flush()
    file.finish()
    return file.path


def exercise(path):
    """Read everything there is to read."""
    with LogReader(path) as log:
        _ = log.run
        frames = [item.event.frame for item in log.decisions() if isinstance(item.event, FrameArrived)]
        for _ in log.entries():
            pass
        for frame in frames:
            log.picture(FISHEYE_IMAGE, frame)


def refusal_of(act, path):
    """The one error that may come of damaged bytes."""
    try:
        act(path)
    except LogError as error:
        return error
    return None


def mutated(data, chance):
    """One of the ways in which bytes go wrong."""
    data = bytearray(data)
    way = chance.randrange(6)
    at = chance.randrange(len(data))
    if way == 0:
        return data[:at]
    if way == 1:
        data[at] = chance.randrange(256)
    elif way == 2:
        data[at : at + 8] = struct.pack("<Q", chance.choice([0, 1, 2**31, 2**40, 2**63, 2**64 - 1]))[: len(data) - at]
    elif way == 3:
        del data[at : at + chance.randrange(1, 64)]
    elif way == 4:
        data[at:at] = chance.randbytes(chance.randrange(1, 64))
    else:
        for _ in range(20):
            data[chance.randrange(len(data))] = chance.randrange(256)
    return data


@pytest.mark.usefixtures("unsynced")
def test_damaged_files_end_in_one_clear_line(small, tmp_path, prompt_disk):
    whole = small.read_bytes()
    chance = random.Random(5)
    victim = tmp_path / "victim.mcap"
    refused = 0
    for _ in range(CASES):
        victim.write_bytes(mutated(whole, chance))
        refusal = refusal_of(exercise, victim)
        refused += refusal is not None
        assert "\n" not in str(refusal)
        if refusal_of(recover, victim) is None:
            assert not isinstance(refusal_of(exercise, victim), Torn), "what was recovered is whole"
    assert refused > CASES / 3
    print(
        f"{CASES} damaged files, {refused} refused, peak {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss >> 10} MiB"
    )


def places(path):
    """Where a file can end: before, inside and behind the head, the body and the end of every record, and of chunks."""
    with RecordFile(path) as file:
        frames = list(file.frames())
        found = {0, 1, len(MAGIC) - 1, len(MAGIC), file.size - 1, file.size - len(MAGIC), file.size - len(MAGIC) + 1}
        kinds = {frame.opcode: frame for frame in frames}
        for frame in frames:
            found |= {frame.start, frame.end - 1}
            if frame.opcode not in {Opcode.CHUNK, Opcode.MESSAGE_INDEX} and frame != kinds[frame.opcode]:
                continue
            found |= {frame.start + 1, frame.start + 8, frame.body, frame.body + 1, frame.body + frame.length // 2}
            if frame.opcode == Opcode.CHUNK:
                data = file.chunk(frame)
                first = frame.end - data.packed_size
                found |= {first - 1, first, *(first + record.end for record in inner_frames(data.data))}
    return sorted(place for place in found if place < file.size)


@pytest.mark.usefixtures("unsynced")
def test_a_file_cut_at_any_boundary_is_torn_and_can_be_mended(small, tmp_path):
    whole = small.read_bytes()
    with LogReader(small) as log:
        expected = list(log.entries())
    victim = tmp_path / "victim.mcap"
    cuts = places(small)
    assert len(cuts) > 100
    for cut in cuts:
        victim.write_bytes(whole[:cut])
        assert isinstance(refusal_of(exercise, victim), LogError), cut
        if cut < len(MAGIC):
            assert "not an MCAP file" in str(refusal_of(recover, victim))
            continue
        report = recover(victim)
        for aside in tmp_path.glob("*.cut"):
            aside.unlink()
        with LogReader(victim) as log:
            kept = list(log.entries())
        assert kept == expected[: len(kept)], cut
        assert report.messages == len(kept)
        assert recover(victim).note == "whole"
    assert kept == expected


@pytest.mark.parametrize("content", [b"", b"x", MAGIC, MAGIC + MAGIC, MAGIC + b"\x06" + b"\xff" * 8, b"\x00" * 100])
def test_hardly_anything(tmp_path, content):
    path = tmp_path / "hardly.mcap"
    path.write_bytes(content)
    with pytest.raises(LogError):
        exercise(path)


def test_a_missing_file_and_a_directory_are_named(tmp_path):
    for path in (tmp_path / "no.mcap", tmp_path):
        with pytest.raises(LogError, match=str(path)):
            exercise(path)


def test_a_torn_file_gives_what_is_whole_and_then_says_so(small, tmp_path):
    torn = tmp_path / "torn.mcap"
    torn.write_bytes(small.read_bytes()[:-1])
    found = []
    with pytest.raises(Torn, match="torn at byte"), LogReader(torn) as log:
        found.extend(log.decisions())
    assert len(found) == 12
    with LogReader(torn, torn_ok=True) as log:
        assert list(log.decisions()) == found


def test_a_foreign_file_is_named_as_such(tmp_path):
    path = tmp_path / "foreign.mcap"
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        writer.finish()
    with pytest.raises(LogError, match="no log of ptzd"):
        exercise(path)


@pytest.mark.parametrize("compression", [CompressionType.NONE, CompressionType.LZ4, CompressionType.ZSTD])
@pytest.mark.parametrize("chunked", [True, False])
def test_files_rewritten_by_other_tools(small, tmp_path, run, compression, chunked):
    """Compressed, or without chunks or indexes: the content is the same."""
    path = tmp_path / "other.mcap"
    with path.open("wb") as stream:
        writer = Writer(stream, compression=compression, use_chunking=chunked, index_types=IndexType.NONE)
        writer.start()
        writer.add_metadata("ptzd.run", run.metadata())
        for name, text in (("config.yaml", run.config_text), ("rig.yaml", run.calibration_text)):
            writer.add_attachment(0, 0, name, "application/yaml", text.encode())
        schema = writer.register_schema("x", "jsonschema", b"{}")
        channels = {topic: writer.register_channel(topic, "json", schema) for topic in (EVENT, FISHEYE_IMAGE)}
        with LogReader(small) as log:
            expected = list(log.entries())
            for entry in expected:
                writer.add_message(channels[entry.topic], entry.log_ns, entry.data, entry.publish_ns, entry.sequence)
        writer.finish()
    exercise(path)
    with LogReader(path) as log:
        assert list(log.entries()) == expected
    assert recover(path).note == "whole"


def test_a_body_of_an_unknown_class_is_named(tmp_path, run):
    file = McapFile(tmp_path / "odd.mcap", run, T0)
    file.open()
    file.add(EVENT, T0, T0, 1, b'{"sequence":1,"t_ns":1,"name":"Dream","body":"{}"}')
    file.add(EVENT, T0, T0, 1, b'{"sequence":"x"}')
    file.finish()
    with LogReader(file.path) as log, pytest.raises(LogError, match="'Dream' is unknown"):
        list(log.decisions())


def test_an_attachment_that_was_changed_is_noticed(small, tmp_path):
    changed = tmp_path / "changed.mcap"
    changed.write_bytes(small.read_bytes().replace(b"ptzd_calibration: 1", b"ptzd_calibration: 2"))
    with LogReader(changed) as log, pytest.raises(LogError, match="attached calibration is not the one"):
        _ = log.run


def test_write_order_is_kept_where_times_are_equal(tmp_path, run):
    file = McapFile(tmp_path / "order.mcap", run, T0)
    file.open()
    order = [(EVENT, number) if number % 3 else (FISHEYE_IMAGE, number) for number in range(30)]
    for topic, number in order:
        file.add(topic, T0, T0, number, event_document(number, T0) if topic == EVENT else image(number))
    file.finish()
    with LogReader(file.path) as log:
        assert [(entry.topic, entry.sequence) for entry in log.entries()] == order


def test_deadlines_have_no_more_than_their_time():
    assert encode(DeadlinePassed()) == ("DeadlinePassed", b"{}")
