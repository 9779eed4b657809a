from __future__ import annotations

import errno
from pathlib import Path

import pytest

from ptzd.devices.v4l2_list import SizeOffer, list_devices


@pytest.fixture
def dev(tmp_path):
    for name in ("video0", "video2", "video10", "ptzd", "v4l/by-id"):
        target = tmp_path / name
        target.mkdir(parents=True) if "/" in name or name == "ptzd" else target.touch()
    (tmp_path / "ptzd/fisheye").symlink_to("../video2")
    (tmp_path / "v4l/by-id/usb-fake-video-index0").symlink_to("../../video2")
    return tmp_path


def test_devices_come_in_the_order_of_their_numbers_with_their_stable_names(dev, kernel):
    offers, failures = list_devices(dev, kernel.open)
    assert [Path(offer.path).name for offer in offers] == ["video0", "video2", "video10"]
    assert offers[1].stable_names == (f"{dev}/ptzd/fisheye", f"{dev}/v4l/by-id/usb-fake-video-index0")
    assert (offers[0].stable_names, failures) == ((), ())


def test_formats_sizes_rates_and_controls_are_listed(dev, kernel, make_control):
    kernel.controls = [make_control(1, "Gain", 0, 255, 0)]
    offer = list_devices(dev, kernel.open)[0][0]
    assert (offer.card, offer.driver, offer.bus) == ("Fake Camera", "fake", "usb-1")
    assert [(found.fourcc, [str(size) for size in found.sizes]) for found in offer.formats] == [
        ("MJPG", ["64x48 @ 30, 15 fps", "32x24 @ 30, 15 fps"]),
        ("YUYV", ["64x48 @ 30, 15 fps"]),
        ("GREY", ["64x48 @ 30, 15 fps"]),
    ]
    assert [control.key for control in offer.controls] == ["gain"]


def test_a_device_is_told_in_lines_that_settings_can_be_written_from(dev, kernel, make_control):
    kernel.controls = [make_control(1, "Gain", 0, 255, 0)]
    kernel.sizes = {"MJPG": [(64, 48)], "H264": []}
    first, second, _ = list_devices(dev, kernel.open)[0]
    assert first.lines()[0].startswith(f"{dev}/video0 (no stable name): Fake Camera")
    assert second.lines() == [
        f"{dev}/ptzd/fisheye: Fake Camera ({dev}/video2, fake, usb-1)",
        "  MJPG: 64x48 @ 30, 15 fps",
        "  H264: sizes not told",
        "  gain: 0 to 255, default 0",
    ]


def test_nodes_that_do_not_capture_are_left_out(dev, kernel):
    kernel.caps = 0x00800000
    assert list_devices(dev, kernel.open) == ((), ())


def test_nodes_that_cannot_be_asked_are_told_with_the_reason(dev, kernel):
    kernel.plugged, kernel.open_error = False, errno.EACCES
    offers, failures = list_devices(dev, kernel.open)
    assert offers == ()
    assert len(failures) == 3
    assert "group video" in str(failures[0])


def test_a_machine_without_cameras_has_an_empty_list(tmp_path, kernel):
    assert list_devices(tmp_path, kernel.open) == ((), ())


@pytest.mark.parametrize(
    ("largest", "fps", "text"),
    [((48, 32), (), "48x32"), ((96, 64), (30.0, 7.5), "48x32 to 96x64 @ 30, 7.5 fps")],
)
def test_sizes_read_well(largest, fps, text):
    assert str(SizeOffer(smallest_px=(48, 32), largest_px=largest, fps=fps)) == text
