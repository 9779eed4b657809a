from __future__ import annotations

import errno
import tracemalloc
from contextlib import closing

import cv2
import msgspec
import numpy as np
import pytest
from hypothesis import HealthCheck, given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st

from ptzd.devices import v4l2_abi as abi
from ptzd.devices.v4l2_capture import BUFFERS, Tally, open_capture
from ptzd.errors import DeviceLost, DeviceRefused


@pytest.fixture
def tally():
    return Tally()


@pytest.fixture
def capture(kernel, settings, tally):
    with closing(open_capture(settings, kernel.open, tally)) as capture:
        yield capture


def test_a_picture_comes_out_as_it_went_in_with_its_stamp(capture, kernel, jpeg):
    kernel.device.shoot(jpeg(1), t_ns=5_000_001_000)
    shot = capture.newest()
    assert (shot.data, shot.number, shot.t_monotonic_ns) == (jpeg(1), 0, 5_000_001_000)
    assert capture.newest() is None


def test_the_newest_wins_and_the_others_are_counted(capture, kernel, jpeg, tally):
    for number in range(BUFFERS):
        kernel.device.shoot(jpeg(number))
    shot = capture.newest()
    assert (shot.data, shot.number) == (jpeg(BUFFERS - 1), BUFFERS - 1)
    assert tally.superseded == BUFFERS - 1


def test_what_the_driver_had_no_buffer_for_is_a_gap(capture, kernel, jpeg):
    for number in range(BUFFERS + 3):
        kernel.device.shoot(jpeg(number))
    assert capture.newest().number == BUFFERS - 1
    kernel.device.shoot(jpeg(9))
    assert capture.newest().number == BUFFERS + 3


@pytest.mark.parametrize("damage", ["flagged", "cut off", "empty", "no start"])
def test_what_is_not_a_whole_picture_is_counted_and_not_delivered(capture, kernel, jpeg, tally, damage):
    whole = jpeg(1)
    data = {
        "flagged": whole,
        "cut off": whole[:-20],
        "empty": b"",
        "no start": whole[2:],
    }[damage]
    kernel.device.shoot(data, flags=abi.BUF_FLAG_ERROR if damage == "flagged" else 0)
    assert capture.newest() is None
    assert (tally.flagged, tally.truncated) == ((1, 0) if damage == "flagged" else (0, 1))
    kernel.device.shoot(whole)
    assert capture.newest().number == 1


@pytest.mark.parametrize("behind", [bytes(100), bytes(8) + b"x", b"\xff" * 3, bytes(range(90))])
def test_what_is_left_behind_the_end_marker_is_not_part_of_the_picture(capture, kernel, jpeg, behind):
    kernel.device.shoot(jpeg(1) + behind)
    assert capture.newest().data == jpeg(1)


def test_an_older_longer_picture_in_the_same_buffer_is_not_taken_along(capture, kernel, jpeg):
    kernel.device.shoot(jpeg(1) + jpeg(2)[200:])
    assert capture.newest().data == jpeg(1)


def test_a_good_picture_is_not_lost_to_a_damaged_one_behind_it(capture, kernel, jpeg):
    kernel.device.shoot(jpeg(1))
    kernel.device.shoot(jpeg(2)[:50])
    shot = capture.newest()
    assert (shot.data, shot.number) == (jpeg(1), 0)


@hypothesis_settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.lists(st.sampled_from(["good", "cut", "flagged", "read"]), max_size=60))
def test_every_picture_is_accounted_for_and_every_buffer_comes_back(kernel, settings, jpeg, actions):
    tally = Tally()
    delivered, shots = [], 0
    with closing(open_capture(settings, kernel.open, tally)) as capture:
        for action in [*actions, "read"]:
            if action == "read":
                shot = capture.newest()
                delivered += [] if shot is None else [shot.number]
                tally.delivered = len(delivered)
                assert sorted(kernel.device.queued) == list(range(BUFFERS))
            else:
                data = jpeg(shots)
                kernel.device.shoot(
                    data[:40] if action == "cut" else data, flags=abi.BUF_FLAG_ERROR if action == "flagged" else 0
                )
                shots += 1
    assert delivered == sorted(set(delivered))
    arrived = tally.delivered + tally.superseded + tally.flagged + tally.truncated
    assert arrived == kernel.device.dequeued
    assert tally.missing == tally.numbered - arrived >= 0


def test_a_clock_other_than_the_monotonic_one_is_not_trusted(kernel, settings, jpeg, tally):
    kernel.stamps = 0
    with closing(open_capture(settings, kernel.open, tally)) as capture:
        kernel.device.shoot(jpeg(1))
        assert capture.newest().t_monotonic_ns is None


def test_numbers_go_on_after_another_opening(kernel, settings, jpeg, tally):
    numbers = []
    for _ in range(2):
        with closing(open_capture(settings, kernel.open, tally)) as capture:
            for number in range(3):
                kernel.device.shoot(jpeg(number))
                numbers.append(capture.newest().number)
    assert numbers == list(range(6))
    assert tally.openings == 2


def test_an_unplugged_device_is_lost_and_still_closes(capture, kernel):
    kernel.unplug()
    with pytest.raises(DeviceLost, match=r"by-id/usb-fake.*No such device.*plug it in"):
        capture.newest()


@pytest.mark.parametrize(
    ("code", "error", "words"),
    [
        (errno.ENOENT, DeviceLost, "plug it in"),
        (errno.EACCES, DeviceRefused, "group video"),
        (errno.EPERM, DeviceRefused, "DeviceAllow"),
        (errno.ENOTDIR, DeviceRefused, "Not a directory"),
    ],
)
def test_a_device_that_cannot_be_opened_names_itself_and_the_cure(kernel, settings, tally, code, error, words):
    kernel.plugged, kernel.open_error = False, code
    with pytest.raises(error, match=words) as caught:
        open_capture(settings, kernel.open, tally)
    assert settings.device in str(caught.value)


@pytest.mark.parametrize("request_name", ["QUERYCAP", "S_FMT", "S_PARM", "REQBUFS", "QUERYBUF", "QBUF", "STREAMON"])
@pytest.mark.parametrize(
    ("code", "error"), [(errno.ENODEV, DeviceLost), (errno.EIO, DeviceLost), (errno.EBUSY, DeviceRefused)]
)
def test_nothing_stays_open_when_a_step_fails(kernel, settings, tally, request_name, code, error):
    kernel.fails[getattr(abi, request_name)] = code
    with pytest.raises(error, match="/dev/v4l/by-id"):
        open_capture(settings, kernel.open, tally)
    assert kernel.open_count == 0


def test_a_size_that_is_not_granted_is_refused_because_the_calibration_depends_on_it(kernel, settings, tally):
    wrong = msgspec.structs.replace(settings, size_px=(640, 480))
    with pytest.raises(DeviceRefused, match=r"asked for MJPG 640x480 px, the driver offers MJPG 64x48 px; set"):
        open_capture(wrong, kernel.open, tally)


def test_a_format_that_is_not_granted_is_refused(kernel, settings, tally):
    kernel.sizes = {"YUYV": [(64, 48)]}
    with pytest.raises(DeviceRefused, match=r"asked for MJPG 64x48 px, the driver offers YUYV"):
        open_capture(settings, kernel.open, tally)


def test_a_node_without_pictures_is_refused(kernel, settings, tally):
    kernel.caps = 0x00800000
    with pytest.raises(DeviceRefused, match="does not stream single-planar video"):
        open_capture(settings, kernel.open, tally)


def test_a_rate_and_controls_that_are_not_granted_are_said(kernel, settings, tally, make_control):
    kernel.controls = [make_control(1, "Gain", 0, 255, 0)]
    wanted = msgspec.structs.replace(settings, fps=60.0, controls={"gain": 300, "focus": 1})
    with closing(open_capture(wanted, kernel.open, tally)) as capture:
        assert capture.layout.shortfalls == (
            "fps: asked for 60, got 30",
            "gain: asked for 300, allowed are 0 to 255, is 255",
            "focus: no such control (has gain)",
        )
        assert capture.layout.period_s == pytest.approx(1 / 30)


@pytest.mark.parametrize("code", [errno.EINVAL, errno.ENOTTY])
def test_a_driver_that_cannot_set_a_rate_is_used_as_it_is(kernel, settings, tally, code):
    kernel.fails[abi.S_PARM] = code
    with closing(open_capture(settings, kernel.open, tally)) as capture:
        assert capture.layout.shortfalls == ("fps: asked for 30, the driver cannot set a rate",)


def test_everything_granted_is_silent(capture):
    assert capture.layout.shortfalls == ()
    assert capture.layout.card == "Fake Camera"


@pytest.mark.parametrize("short", [False, True])
def test_a_raw_picture_is_whole_when_all_its_rows_are_there(kernel, settings, tally, short):
    kernel.padding = 16
    grey = msgspec.structs.replace(settings, format="GREY")
    rows = bytes(range(80)) * 48
    with closing(open_capture(grey, kernel.open, tally)) as capture:
        kernel.device.shoot(rows[:-1] if short else rows)
        shot = capture.newest()
    assert tally.truncated == int(short)
    assert (shot is None) if short else (shot.data == rows)


def test_a_picture_is_copied_once_and_nothing_of_it_is_kept(kernel, settings, tally):
    """From the driver's buffer into the picture; memory does not grow with the number of pictures."""
    kernel.sizes["MJPG"] = [(1024, 768)]
    noise = np.random.default_rng(1).integers(0, 255, (768, 1024), np.uint8)
    big = cv2.imencode(".jpg", noise, [cv2.IMWRITE_JPEG_QUALITY, 98])[1].tobytes()
    large = msgspec.structs.replace(settings, size_px=(1024, 768))
    with closing(open_capture(large, kernel.open, tally)) as capture:
        tracemalloc.start()
        try:
            for _ in range(5):
                kernel.device.shoot(big)
                tracemalloc.reset_peak()
                before = tracemalloc.get_traced_memory()[0]
                shot = capture.newest()
                after, peak = tracemalloc.get_traced_memory()
                assert shot.data == big
                assert peak - before < 1.2 * len(big)
                del shot
                assert after - len(big) - before < 0.01 * len(big)
        finally:
            tracemalloc.stop()
