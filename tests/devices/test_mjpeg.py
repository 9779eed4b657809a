"""Pictures come out of a stream whatever stands between them."""

from __future__ import annotations

from itertools import pairwise

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ptzd.devices.mjpeg import MAX_PART_BYTES, MultipartParser, boundary_of
from ptzd.errors import DeviceGarbled


def jpeg(number: int, *options: int) -> bytes:
    pixels = np.add.outer(np.arange(24) * 9, np.arange(32) * 3 + number).astype(np.uint8)
    return cv2.imencode(".jpg", pixels, list(options))[1].tobytes()


PICTURES = [jpeg(number) for number in range(5)] + [jpeg(5, cv2.IMWRITE_JPEG_PROGRESSIVE, 1)]
bodies = st.lists(st.sampled_from(PICTURES), min_size=1, max_size=6)
cuts = st.lists(st.integers(0, 9000), max_size=20)
ends = st.sampled_from([b"\r\n", b"\n"])
framings = st.sampled_from(
    [
        (b"--name", b"name"),
        (b"--name", b"--name"),
        (b"name", b"name"),
        (b"--two words--", b"--two words--"),
        (b"------", b"----"),
        (b"--another", b"name"),
        (b"", b""),
    ]
)


def fed(parser: MultipartParser, data: bytes, at: list[int]) -> list[bytes]:
    edges = [0, *sorted(cut % (len(data) + 1) for cut in at), len(data)]
    return [part.body for a, b in pairwise(edges) for part in parser.feed(data[a:b]) if part.complete]


@given(bodies, cuts, framings, ends, st.integers(-3, 3), st.integers(0, 3), st.integers(0, 3), st.booleans())
def test_any_framing_in_any_chunks_gives_the_pictures(pictures, at, framing, end, off, before, behind, counted):
    delimiter, announced = framing
    data = b"".join(
        end * before
        + delimiter
        + end
        + b"Content-Type: image/jpeg"
        + end
        + (b"Content-Length: %d" % (len(body) + off) + end if counted else b"")
        + end
        + body
        + end * behind
        for body in pictures
    )
    assert fed(MultipartParser(announced.decode()), data, at) == pictures


@given(bodies, st.binary(max_size=400).filter(lambda noise: b"\xff" not in noise), cuts)
def test_noise_between_pictures_costs_none(pictures, noise, at):
    assert fed(MultipartParser("name"), b"".join(noise + body for body in pictures), at) == pictures


@given(bodies, st.data(), cuts)
def test_a_picture_cut_short_costs_none_behind_it(pictures, data, at):
    whole = PICTURES[0]
    cut = whole[: data.draw(st.integers(2, len(whole) - 1))]
    # a segment that was cut may count up to 64 KiB of what follows as its own before the walk notices
    following = [*pictures, *PICTURES * (1 + 65536 // sum(map(len, PICTURES)))]
    stream = b"\r\n".join(b"--name\r\nContent-Type: image/jpeg\r\n\r\n" + body for body in [cut, *following])
    assert fed(MultipartParser("name"), stream, at) == following


@pytest.mark.parametrize("length", range(2, len(PICTURES[0])))
def test_no_place_to_cut_makes_one_picture_of_several(length):
    following = PICTURES * (1 + 65536 // sum(map(len, PICTURES)))
    bodies = [PICTURES[0][:length], *following]
    stream = b"\r\n".join(b"--name\r\n\r\n" + body for body in bodies)
    assert fed(MultipartParser("name"), stream, []) == following


def test_a_long_run_of_dashes_in_a_broken_picture_takes_no_square_of_steps():
    scan = PICTURES[0].index(b"\xff\xda")
    broken = PICTURES[0][: scan + 14] + b"-" * 2_000_000 + b"\xff\x02"
    assert fed(MultipartParser("b"), broken + b"--b\r\n\r\n" + PICTURES[1], []) == [PICTURES[1]]


@given(st.binary(max_size=2000), cuts)
def test_noise_alone_never_raises(noise, at):
    assert all(found.startswith(b"\xff\xd8") for found in fed(MultipartParser("x"), noise, at))


def test_a_picture_is_given_out_with_its_last_byte():
    data = b"--name\r\nContent-Type: image/jpeg\r\n\r\n" + PICTURES[0]
    parser = MultipartParser("name")
    assert list(parser.feed(data[:-1])) == []
    assert [part.body for part in parser.feed(data[-1:])] == [PICTURES[0]]


def test_noise_takes_no_memory():
    parser = MultipartParser("name")
    for _ in range(100):
        list(parser.feed(bytes(10_000)))
    assert len(parser._buffer) < 1000


def test_a_picture_without_end_is_given_up_at_the_cap_and_the_next_one_comes():
    parser = MultipartParser("name")
    list(parser.feed(PICTURES[0][:-2]))
    broken = [part for _ in range(MAX_PART_BYTES // (1 << 20) + 1) for part in parser.feed(bytes(1 << 20))]
    assert [part.complete for part in broken] == [False]
    assert [part.body for part in parser.feed(b"--name\r\n\r\n" + PICTURES[1])] == [PICTURES[1]]


@pytest.mark.parametrize(
    ("content_type", "boundary"),
    [
        ("multipart/x-mixed-replace; boundary=name", "name"),
        ("multipart/x-mixed-replace;boundary=--a name--", "--a name--"),
        ('multipart/x-mixed-replace; boundary="--name"; charset=x', "--name"),
        ('multipart/x-mixed-replace; boundary="--name', "--name"),
        ("Multipart/X-Mixed-Replace; charset=x; Boundary = name ", "name"),
        ("multipart/x-mixed-replace", ""),
        ("multipart/x-mixed-replace; boundary=", ""),
    ],
)
def test_every_way_to_announce_a_boundary(content_type, boundary):
    assert boundary_of(content_type) == boundary


@pytest.mark.parametrize("content_type", ["", "text/html", "image/jpeg", "x; boundary=a"])
def test_what_is_no_stream_is_said_with_the_content_type(content_type):
    with pytest.raises(DeviceGarbled, match="content type"):
        boundary_of(content_type)


def test_what_was_seen_in_place_of_pictures_is_told():
    parser = MultipartParser("name")
    assert parser.seen() == "nothing came"
    list(parser.feed(b"<html>sign in</html>"))
    assert "begins with b'<html>sign in</html" in parser.seen()
    list(parser.feed(PICTURES[0][:-9] + PICTURES[1]))
    assert "1 whole and 1 broken" in parser.seen()
