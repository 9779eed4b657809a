"""Pictures that can still be written, and for how long."""

import pytest

from ptzd.log.recent_pictures import RecentPictures

TOPIC = "/fisheye/image"


@pytest.fixture
def recent():
    return RecentPictures(1_000_000_000)


def test_pictures_are_kept_for_their_time(recent, picture):
    for seq in range(100):
        recent.add(TOPIC, picture(seq))
    assert len(recent) == 31
    assert recent.want(TOPIC, picture(99).frame) == picture(99)


def test_one_that_is_gone_may_yet_come(recent, picture):
    assert recent.want(TOPIC, picture(1).frame) is None
    assert recent.wanted(TOPIC, picture(1).frame)
    recent.wrote(TOPIC, picture(1).frame)
    assert not recent.wanted(TOPIC, picture(1).frame)


def test_the_present_file_needs_a_picture_once(recent, picture):
    recent.add(TOPIC, picture(1))
    recent.wrote(TOPIC, picture(1).frame)
    assert recent.written(TOPIC, picture(1).frame)
    assert recent.want(TOPIC, picture(1).frame) is None
    assert recent.begin_file() == []
    assert recent.want(TOPIC, picture(1).frame) == picture(1), "the next file does not have it"


def test_pictures_in_use_outlive_the_horizon_and_go_into_every_file(recent, picture):
    recent.add(TOPIC, picture(1))
    recent.use("a", TOPIC, picture(1).frame)
    recent.use("b", TOPIC, picture(1).frame)
    recent.add(TOPIC, picture(900))
    assert len(recent) == 1
    assert recent.begin_file() == [(TOPIC, picture(1))]
    recent.release("a")
    assert recent.want(TOPIC, picture(1).frame) == picture(1)
    recent.release("b")
    recent.release("b")
    assert recent.begin_file() == []


def test_a_stream_that_starts_anew_has_other_pictures(recent, picture):
    recent.add(TOPIC, picture(1))
    recent.wrote(TOPIC, picture(1).frame)
    assert not recent.written(TOPIC, picture(1, t_ns=7).frame)


def test_what_is_remembered_is_bounded(recent, picture):
    for seq in range(3000):
        recent.want(TOPIC, picture(seq).frame)
    assert not recent.wanted(TOPIC, picture(0).frame)
    assert recent.wanted(TOPIC, picture(2999).frame)
