from __future__ import annotations

from itertools import pairwise

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ptzd.devices.mjpeg import MAX_PART_BYTES, MultipartParser, boundary_of, jpeg_size
from ptzd.errors import DeviceGarbled

NAME = b"myboundary"


def jpeg(payload: bytes) -> bytes:
    return b"\xff\xd8" + payload + b"\xff\xd9"


def part(body: bytes, *, counted: bool = True, end: bytes = b"\r\n", length: int | None = None) -> bytes:
    head = [b"--" + NAME, b"Content-Type: image/jpeg"]
    if counted:
        head.append(b"Content-Length: %d" % (len(body) if length is None else length))
    return end.join([*head, b"", body, b""])


payloads = st.binary(max_size=300).filter(lambda data: NAME not in data and b"\xff" not in data)
bodies = st.lists(payloads.map(jpeg), min_size=1, max_size=6)


def fed(parser: MultipartParser, data: bytes, cuts: list[int]) -> list[bytes]:
    edges = [0, *sorted(cut % (len(data) + 1) for cut in cuts), len(data)]
    chunks = (data[a:b] for a, b in pairwise(edges))
    return [found.body for chunk in chunks for found in parser.feed(chunk)]


@given(bodies, st.lists(st.integers(0, 5000), max_size=20), st.booleans(), st.sampled_from([b"\r\n", b"\n"]))
def test_any_chunking_gives_the_same_pictures(pictures, cuts, counted, end):
    data = b"".join(part(body, counted=counted, end=end) for body in pictures) + b"--" + NAME + end
    assert fed(MultipartParser("myboundary"), data, cuts) == pictures


@given(bodies, st.binary(max_size=400), st.lists(st.integers(0, 5000), max_size=10))
def test_noise_costs_at_most_the_next_picture(pictures, noise, cuts):
    data = noise + b"\r\n" + b"".join(part(body) for body in [b"\xff\xd8\xff\xd9", *pictures])
    found = fed(MultipartParser("myboundary"), data, cuts)
    assert found[-len(pictures) :] == pictures


@given(st.binary(max_size=2000), st.lists(st.integers(0, 2000), max_size=10))
def test_noise_alone_never_raises(noise, cuts):
    fed(MultipartParser("x"), noise.replace(b"Content-Length", b""), cuts)


@given(bodies, st.integers(1, 50), st.lists(st.integers(0, 5000), max_size=10))
def test_a_picture_cut_short_does_not_swallow_the_next(pictures, missing, cuts):
    whole = jpeg(b"\x11" * 100)
    data = part(whole[:-missing], length=len(whole)) + b"".join(map(part, pictures)) + part(whole)
    parser = MultipartParser("myboundary")
    edges = [0, *sorted(cut % (len(data) + 1) for cut in cuts), len(data)]
    parts = [found for a, b in pairwise(edges) for found in parser.feed(data[a:b])]
    assert not parts[0].complete
    assert [found.body for found in parts if found.complete][: len(pictures)] == pictures


def test_a_counted_picture_is_given_out_with_its_last_byte():
    body = jpeg(b"abc")
    data = part(body)
    parser = MultipartParser("myboundary")
    assert parser.feed(data[:-3]) == []
    assert [found.body for found in parser.feed(data[-3:-2])] == [body]


def test_content_length_comes_before_a_boundary_inside_the_picture():
    body = jpeg(b"\r\n--" + NAME + b"\r\nContent-Length: 2\r\n\r\n")
    assert [found.body for found in MultipartParser("myboundary").feed(part(body))] == [body]


@pytest.mark.parametrize(
    "content_type",
    [
        "multipart/x-mixed-replace; boundary=myboundary",
        "multipart/x-mixed-replace; boundary=--myboundary",
        'multipart/x-mixed-replace;boundary="--myboundary"',
        "Multipart/X-Mixed-Replace; charset=x; Boundary=myboundary ",
    ],
)
def test_every_way_to_announce_a_boundary(content_type):
    body = jpeg(b"1")
    parser = MultipartParser(boundary_of(content_type))
    assert [found.body for found in parser.feed(b"\r\n\r\n" + part(body))] == [body]


@pytest.mark.parametrize("content_type", ["", "text/html", "image/jpeg", "multipart/x-mixed-replace", "x; boundary=a"])
def test_no_boundary_is_said_with_the_content_type(content_type):
    with pytest.raises(DeviceGarbled, match="content type"):
        boundary_of(content_type)


def test_a_boundary_of_dashes_is_refused():
    with pytest.raises(DeviceGarbled, match="has no name"):
        MultipartParser("----")


def test_another_boundary_that_starts_alike_is_not_taken_for_it():
    body = jpeg(b"1")
    data = part(body).replace(NAME, NAME + b"2") + part(jpeg(b"2"))
    assert [found.body for found in MultipartParser("myboundary").feed(data)] == [jpeg(b"2")]


def test_a_length_beyond_the_cap_is_refused():
    with pytest.raises(DeviceGarbled, match="announces 20000001 bytes"):
        MultipartParser("myboundary").feed(part(b"", length=MAX_PART_BYTES + 1))


def test_a_part_without_end_is_refused_at_the_cap():
    parser = MultipartParser("myboundary")
    parser.feed(part(b"\xff\xd8", counted=False))
    chunk = bytes(1 << 20)
    for _ in range(MAX_PART_BYTES // len(chunk)):
        parser.feed(chunk)
    with pytest.raises(DeviceGarbled, match="grew beyond"):
        parser.feed(chunk)


def test_noise_takes_no_memory():
    parser = MultipartParser("myboundary")
    for _ in range(100):
        parser.feed(bytes(10_000))
    assert len(parser._buffer) < 1000


def test_endless_headers_are_given_up():
    parser = MultipartParser("myboundary")
    parser.feed(b"--" + NAME + b"\r\n" + b"X: y\r\n" * 5000)
    assert [found.body for found in parser.feed(part(jpeg(b"1")))] == [jpeg(b"1")]


@settings(max_examples=20)
@given(st.integers(1, 40), st.integers(1, 40), st.booleans())
def test_size_is_read_from_the_frame_header(width, height, progressive):
    options = [cv2.IMWRITE_JPEG_PROGRESSIVE, int(progressive)]
    data = cv2.imencode(".jpg", np.zeros((height, width), np.uint8), options)[1].tobytes()
    assert jpeg_size(data) == (width, height)


@given(st.binary(max_size=200))
def test_size_of_noise_never_raises(data):
    assert jpeg_size(b"\xff\xd8" + data) is None or len(data) > 7
