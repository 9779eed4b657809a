"""Pictures are read by others as they were written, and the other way round."""

import pytest
from foxglove.messages import CompressedImage as TheirImage
from foxglove.messages import Timestamp
from hypothesis import given
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

from ptzd.errors import LogError
from ptzd.log.file import McapFile
from ptzd.log.protobuf import CompressedImage, decode_image, encode_image
from ptzd.log.topics import FISHEYE_IMAGE

IMAGES = st.builds(
    CompressedImage,
    t_ns=st.integers(0, 2**62),
    frame_id=st.text(max_size=10),
    data=st.binary(max_size=300),
    format=st.sampled_from(["jpeg", "png", ""]),
)


@given(IMAGES)
def test_round_trip(image):
    assert decode_image(encode_image(image)) == image


def test_an_independent_reader_decodes_the_file(tmp_path, run):
    file = McapFile(tmp_path / "a.mcap", run, 5)
    file.open()
    for number in range(20):
        t_ns = 1_795_000_000_123_456_789 + number
        image = CompressedImage(t_ns=t_ns, frame_id="fisheye", data=bytes([number]) * 1000, format="jpeg")
        file.add(FISHEYE_IMAGE, t_ns, t_ns, number, encode_image(image))
    file.finish()
    with file.path.open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        found = [decoded.decoded_message for decoded in reader.iter_decoded_messages()]
    assert len(found) == 20
    for number, message in enumerate(found):
        assert message.timestamp.ToNanoseconds() == 1_795_000_000_123_456_789 + number
        assert (message.frame_id, message.format, message.data) == ("fisheye", "jpeg", bytes([number]) * 1000)


def test_what_the_sdk_writes_is_read():
    theirs = TheirImage(
        timestamp=Timestamp(sec=12, nsec=34), frame_id="camera", data=b"\xff\xd8\xff\xd9", format="jpeg"
    )
    image = CompressedImage(t_ns=12_000_000_034, frame_id="camera", data=b"\xff\xd8\xff\xd9", format="jpeg")
    assert decode_image(theirs.encode()) == image


@given(IMAGES, st.data())
def test_damaged_messages_are_refused_or_read(image, data):
    message = bytearray(encode_image(image))
    at = data.draw(st.integers(0, len(message) - 1))
    message[at] = data.draw(st.integers(0, 255))
    try:
        decode_image(bytes(message[: data.draw(st.integers(0, len(message)))]))
    except LogError as error:
        assert str(error).startswith("picture message:")  # noqa: PT017 - both ends are right


def test_unknown_fields_are_skipped():
    image = CompressedImage(t_ns=7, frame_id="f", data=b"x", format="jpeg")
    fixed64, fixed32 = b"\x79" + b"\x00" * 8, b"\x7d" + b"\x00" * 4
    assert decode_image(encode_image(image) + fixed64 + fixed32 + b"\x78\x05") == image


@pytest.mark.parametrize("message", [b"\x0b", b"\x12\x7f", b"\x10", b"\xff" * 11, b"\x10\x01", b"\x0a\x02\x08"])
def test_garbage_is_refused(message):
    with pytest.raises(LogError, match="picture message"):
        decode_image(message)
