from __future__ import annotations

import errno
import os
from contextlib import closing

import pytest

from ptzd.devices import v4l2_abi as abi
from ptzd.devices import v4l2_kernel
from ptzd.devices.v4l2_capture import Tally, open_capture
from ptzd.devices.v4l2_kernel import KernelDevice, device_error
from ptzd.errors import DeviceLost, DeviceRefused


@pytest.fixture
def node(tmp_path):
    path = tmp_path / "video0"
    path.write_bytes(b"frame" + bytes(4091))
    return str(path)


def test_the_kernel_answers_that_a_file_is_no_camera(node):
    with closing(KernelDevice.open(node)) as device, pytest.raises(OSError, match="Inappropriate ioctl") as caught:
        device.ioctl(abi.QUERYCAP, abi.Capability())
    assert caught.value.errno == errno.ENOTTY


def test_a_file_in_a_cameras_place_is_refused_with_the_cure(settings):
    with pytest.raises(DeviceRefused, match="not a video capture device; see `ptzd check`"):
        open_capture(settings, lambda _: KernelDevice.open(os.devnull), Tally())


def test_opening_does_not_wait_and_is_not_inherited(node):
    with closing(KernelDevice.open(node)) as device:
        assert os.get_blocking(device.fileno()) is False
        assert os.get_inheritable(device.fileno()) is False


def test_mapped_memory_is_the_devices_own(node):
    with closing(KernelDevice.open(node)) as device, device.map(4096, 0) as memory:
        assert memory[:5] == b"frame"
        memory[:5] = b"other"
        assert os.pread(device.fileno(), 5, 0) == b"other"


def test_a_request_that_a_signal_interrupts_is_done_again(node, monkeypatch):
    answers = [InterruptedError(errno.EINTR, "Interrupted"), None]

    def ioctl(descriptor, request, argument):
        answer = answers.pop(0)
        if answer is not None:
            raise answer

    monkeypatch.setattr(v4l2_kernel.fcntl, "ioctl", ioctl)
    with closing(KernelDevice.open(node)) as device:
        device.ioctl(abi.QUERYCAP, abi.Capability())
    assert answers == []


@pytest.mark.parametrize("code", sorted(v4l2_kernel.GONE))
def test_answers_of_an_absent_device_are_losses(code):
    assert isinstance(device_error(OSError(code, os.strerror(code)), "cam", "open it"), DeviceLost)


@pytest.mark.parametrize("code", sorted(v4l2_kernel.CURES))
def test_answers_that_waiting_does_not_change_are_refusals_with_a_cure(code):
    error = device_error(OSError(code, os.strerror(code)), "cam", "open it")
    assert isinstance(error, DeviceRefused)
    assert str(error) == f"cam: cannot open it: {os.strerror(code)}; {v4l2_kernel.CURES[code]}"
