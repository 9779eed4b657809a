from __future__ import annotations

import contextlib

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ptzd.errors import DeviceGarbled
from ptzd.runtime.frames import FrameStore, jpeg_size_px


@given(st.integers(1, 200), st.integers(1, 200), st.booleans())
def test_the_size_of_a_jpeg_is_read_from_its_header(width: int, height: int, progressive: bool) -> None:
    pixels = np.zeros((height, width, 3), np.uint8)
    jpeg = cv2.imencode(".jpg", pixels, [cv2.IMWRITE_JPEG_PROGRESSIVE, int(progressive)])[1].tobytes()
    assert jpeg_size_px(jpeg) == (width, height)


@given(st.binary(max_size=200))
def test_what_is_no_jpeg_is_refused_or_has_some_size(data: bytes) -> None:
    with contextlib.suppress(DeviceGarbled):
        assert jpeg_size_px(data) >= (0, 0)


def test_the_ring_forgets_the_oldest(picture) -> None:
    store = FrameStore(3)
    frames = [picture(seq) for seq in range(5)]
    for frame in frames:
        store.add(frame)
    assert [store.fisheye(frame.frame) is not None for frame in frames] == [False, False, True, True, True]


def test_a_pinned_frame_stays_until_its_request_is_over(picture) -> None:
    store = FrameStore(1)
    old, new = picture(1), picture(2)
    store.add(old)
    assert store.pin("a", old.frame) is old
    assert store.pin("b", old.frame) is old
    store.add(new)
    store.clear_ring()
    assert store.fisheye(old.frame) is old
    assert store.fisheye(new.frame) is None
    store.release("a")
    assert store.fisheye(old.frame) is old
    store.release("b")
    assert store.fisheye(old.frame) is None
    store.release("b")


def test_what_is_gone_cannot_be_pinned(picture) -> None:
    store = FrameStore(1)
    assert store.pin("a", picture(1).frame) is None


def test_views_are_kept_for_a_scan(picture) -> None:
    store = FrameStore(2)
    views = [picture(seq) for seq in range(3)]
    for view in views:
        store.add_view(view)
    assert [store.view(view.frame) for view in views] == [None, views[1], views[2]]
    assert store.fisheye(views[2].frame) is None


@pytest.mark.parametrize("jpeg", [b"", b"\xff\xd8", b"\xff\xd8\xff\xd9", b"GIF89a" * 5])
def test_a_picture_without_a_frame_header_is_garbled(jpeg: bytes) -> None:
    with pytest.raises(DeviceGarbled, match="really JPEG"):
        jpeg_size_px(jpeg)
