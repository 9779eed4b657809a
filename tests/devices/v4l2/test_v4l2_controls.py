from __future__ import annotations

import errno
import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ptzd.devices import v4l2_abi as abi
from ptzd.devices.v4l2_controls import apply_controls, control_key, list_controls


@pytest.fixture
def camera(kernel, make_control):
    kernel.controls = [
        make_control(0x009A0902, "Exposure Time, Absolute", 1, 5000, 157),
        make_control(0x00980913, "Gain", 0, 255, 10),
        make_control(0x00980900, "Model", 0, 3, 0, flags=abi.CTRL_FLAG_READ_ONLY),
        make_control(0x00980901, "User Controls", 0, 0, 0, type=6),
    ]
    device = kernel.open("camera")
    yield device
    device.close()


@pytest.mark.parametrize(
    ("name", "key"),
    [
        ("Exposure Time, Absolute", "exposure_time_absolute"),
        ("White Balance Temperature, Auto", "white_balance_temperature_auto"),
        ("Gain", "gain"),
        ("Zoom, Absolute ", "zoom_absolute"),
    ],
)
def test_keys_are_those_of_v4l2_ctl(name, key):
    assert control_key(name) == key


@given(st.text(max_size=32))
def test_keys_are_made_of_words_and_stay_as_they_are(name):
    key = control_key(name)
    assert re.fullmatch(r"([a-z0-9]+(_[a-z0-9]+)*)?", key)
    assert control_key(key) == key


def test_only_what_one_integer_can_set_is_listed(camera):
    assert [control.key for control in list_controls(camera)] == ["gain", "exposure_time_absolute"]


def test_what_is_granted_is_silent_and_set_in_the_order_given(camera, kernel):
    done = []
    ioctl = camera.ioctl
    camera.ioctl = lambda request, argument: (
        done.append(argument.id) if request == abi.S_CTRL else None,
        ioctl(request, argument),
    )
    assert apply_controls(camera, {"gain": 99, "exposure_time_absolute": 150}) == ()
    assert done == [0x00980913, 0x009A0902]
    assert [control.value for control in kernel.controls[:2]] == [150, 99]


def test_what_is_not_granted_is_said_with_both_values_and_the_range(camera):
    assert apply_controls(camera, {"gain": 999}) == ("gain: asked for 999, allowed are 0 to 255, is 255",)


def test_a_name_that_the_driver_does_not_know_is_said_with_those_it_knows(camera):
    (phrase,) = apply_controls(camera, {"exposre": 1})
    assert phrase == "exposre: no such control (has gain, exposure_time_absolute)"


@pytest.mark.parametrize("code", [errno.EIO, errno.EINVAL, errno.EACCES, errno.EBUSY])
def test_a_refused_control_does_not_stop_the_others(camera, kernel, code):
    kernel.controls[0].refuses = code
    phrases = apply_controls(camera, {"exposure_time_absolute": 150, "gain": 20})
    assert len(phrases) == 1
    assert "exposure_time_absolute" in phrases[0]
    assert kernel.controls[1].value == 20


def test_a_device_that_goes_away_is_no_matter_of_controls(camera, kernel):
    kernel.unplug()
    with pytest.raises(OSError, match="No such device"):
        apply_controls(camera, {"gain": 20})


def test_a_control_that_cannot_be_asked_hides_no_other(camera, kernel, make_control):
    kernel.controls += [make_control(number, f"Part {number:x}", 0, 9, 1) for number in (0x00980914, 0x009A0910)]
    ioctl = camera.ioctl

    def broken(request, argument):
        number = argument.id & ~abi.CTRL_FLAG_NEXT_CTRL if request == abi.QUERYCTRL else None
        following = request == abi.QUERYCTRL and argument.id & abi.CTRL_FLAG_NEXT_CTRL
        known = sorted(control.id for control in kernel.controls)
        if following and next((control for control in known if control > number), None) == 0x00980914:
            raise OSError(errno.EIO, "Input/output error")
        if number == 0x00980914:
            raise OSError(errno.EIO, "Input/output error")
        ioctl(request, argument)

    camera.ioctl = broken
    assert [control.key for control in list_controls(camera)] == ["gain", "exposure_time_absolute", "part_9a0910"]
    assert apply_controls(camera, {"gain": 20, "exposure_time_absolute": 200}) == ()


def test_what_switches_something_automatic_goes_before_what_it_governs(kernel, make_control):
    kernel.controls = [
        make_control(0x009A0901, "Auto Exposure", 0, 3, 3),
        make_control(0x009A0902, "Exposure Time, Absolute", 1, 5000, 157),
    ]
    device = kernel.open("camera")
    ioctl = device.ioctl

    def governed(request, argument):
        if request == abi.S_CTRL and argument.id == 0x009A0902 and kernel.controls[0].value != 1:
            raise OSError(errno.EACCES, "Permission denied")
        ioctl(request, argument)

    device.ioctl = governed
    assert apply_controls(device, {"exposure_time_absolute": 150, "auto_exposure": 1}) == ()
    assert [control.value for control in kernel.controls] == [1, 150]
    device.close()


def test_a_value_that_waits_for_a_switch_of_any_name_is_set_when_that_is(kernel, make_control):
    kernel.controls = [
        make_control(0x009A0910, "Iris", 0, 100, 5),
        make_control(0x009A0911, "Manual Mode", 0, 1, 0),
    ]
    device = kernel.open("camera")
    ioctl = device.ioctl

    def governed(request, argument):
        if request == abi.S_CTRL and argument.id == 0x009A0910 and not kernel.controls[1].value:
            raise OSError(errno.EBUSY, "Device or resource busy")
        ioctl(request, argument)

    device.ioctl = governed
    assert apply_controls(device, {"iris": 50, "manual_mode": 1}) == ()
    device.close()
