from __future__ import annotations

from ptzd.runtime.frames import FrameStore


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
