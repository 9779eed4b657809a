"""`ptzd check` without a connection: what it says about the machine's cameras."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import msgspec
import pytest
import yaml

from ptzd.app import checking
from ptzd.app.checking import check_devices, check_files
from ptzd.app.loading import Loaded, load
from ptzd.config import FilesSource
from ptzd.devices.v4l2_list import DeviceOffer, FormatOffer, SizeOffer
from ptzd.errors import DeviceRefused
from ptzd.presets import Place, Presets

CALIBRATION = Path(__file__).parents[2] / "config" / "rig.example.yaml"


@pytest.fixture
def loaded(tmp_path: Path) -> Loaded:
    document = {
        "rig": "hall",
        "calibration": str(CALIBRATION),
        "fisheye": {"source": "v4l2", "device": "/dev/ptzd/fisheye", "size_px": [640, 480]},
        "ptz": {"url": "http://192.0.2.20", "user": "ptzd"},
    }
    (tmp_path / "ptzd.yaml").write_text(yaml.safe_dump(document))
    return load(tmp_path / "ptzd.yaml")


def test_every_camera_is_listed_with_its_formats_and_those_that_refuse(loaded, monkeypatch) -> None:
    size = SizeOffer(smallest_px=(640, 480), largest_px=(640, 480), fps=(30.0,))
    offer = DeviceOffer(
        path="/dev/video0", stable_names=("/dev/ptzd/fisheye",), card="Dome", driver="uvcvideo", bus="usb-1",
        formats=(FormatOffer(fourcc="MJPG", description="Motion-JPEG", sizes=(size,)),), controls=(),
    )  # fmt: skip
    refusal = DeviceRefused("/dev/video4: permission denied; join the group video")
    monkeypatch.setattr(checking, "list_devices", lambda: ((offer,), (refusal,)))
    lines = check_devices(loaded)
    assert lines == ["/dev/ptzd/fisheye: Dome (/dev/video0, uvcvideo, usb-1)", f"  MJPG: {size}", str(refusal)]


def test_a_machine_without_a_camera_is_told_so_and_other_fisheyes_need_none(loaded, monkeypatch) -> None:
    monkeypatch.setattr(checking, "list_devices", lambda: ((), ()))
    assert check_devices(loaded) == ["fisheye      no video device on this machine; plug the camera in"]
    files = msgspec.structs.replace(loaded.config, fisheye=FilesSource(path="pictures"))
    assert check_devices(dataclasses.replace(loaded, config=files)) == []


def test_every_place_is_told_with_where_the_head_turns_or_why_it_cannot(loaded) -> None:
    ahead = Place(azimuth_deg=0.0, elevation_deg=0.0, hfov_deg=40.0)
    wide = msgspec.structs.replace(ahead, hfov_deg=170.0)
    presets = Presets(places={"ahead": ahead, "all": wide})
    config = msgspec.structs.replace(loaded.config, presets=presets)
    told = [line for line in check_files(dataclasses.replace(loaded, config=config)) if line.startswith("place")]
    assert told[0].startswith("place        ahead: pan ")
    assert told[1].startswith("place        warning: all is 170° wide, the camera is calibrated for ")
