from __future__ import annotations

from pathlib import Path

import pytest

from ptzd.config import Limits, Ptz
from ptzd.devices.vapix.answers import CameraLimits, Parameters, Reply, parameters
from ptzd.devices.vapix.capabilities import common_limits, surprises
from ptzd.errors import ConfigError

DATA = Path(__file__).parents[2] / "data" / "axis_http"
PTZ = Ptz(url="http://camera", user="u")
CAMERA = CameraLimits(pan_deg=(-180.0, 180.0), tilt_deg=(-100.0, 20.0), zoom=(1.0, 19999.0))


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("PTZ.Various.V1.ReturnToOverview", "30"),
        ("PTZ.Various.V1.CtlQueueing", "true"),
        ("PTZ.Various.V1.Locked", "true"),
        ("PTZ.Various.V1.TiltEnabled", "false"),
        ("PTZ.UserAdv.U1.AutoFlip", "true"),
        ("PTZ.UserAdv.U1.CameraHousingConfiguration", "inverted"),
        ("PTZ.UserAdv.U1.ImageFreeze", "auto"),
        ("GuardTour.G0.Running", "yes"),
        ("Image.I0.Appearance.Rotation", "180"),
        ("Image.I0.Appearance.MirrorEnabled", "yes"),
    ],
)
def test_each_surprise_is_told_by_its_name(name, value):
    (warning,) = surprises(Parameters(values={name: value}), PTZ, 100.0)
    assert warning.startswith(f"{name}={value}: ")


def test_settings_of_another_channel_do_not_matter():
    assert surprises(Parameters(values={"PTZ.Various.V2.ReturnToOverview": "30"}), PTZ, None) == ()


def test_a_slow_speed_and_a_missing_size_are_told():
    found = surprises(Parameters(values={"Properties.Image.Resolution": "1920x1080,800x600"}), PTZ, 40.0)
    assert [text.partition(" ")[0] for text in found] == ["Properties.Image.Resolution", "speed=40:"]


def test_recorded_cameras_surprise_as_expected():
    names = {}
    for path in DATA.glob("p*.txt"):
        reply = Reply(status=200, content_type="text/plain", text=path.read_text(encoding="utf-8"))
        names[path.stem] = [text.partition("=")[0] for text in surprises(parameters(reply), PTZ, None)]
    assert names["ptz__PTZ_RESPONSE"] == []
    assert "PTZ.Various.V1.ReturnToOverview" in names["param_cgi__PARAM_RESPONSE"]


def test_limits_are_what_both_allow():
    found = common_limits(CAMERA, Limits(pan_deg=(-90.0, 90.0), tilt_deg=(-95.0, 5.0)), None)
    assert (found.pan_deg, found.tilt_deg, found.zoom) == ((-90.0, 90.0), (-90.0, 5.0), (1.0, 9999.0))
    assert not found.endless_pan


@pytest.mark.parametrize(("setting", "endless"), [(None, True), (True, True), (False, False)])
def test_a_full_turn_is_endless_unless_told_otherwise(setting, endless):
    assert common_limits(CAMERA, Limits(), setting).endless_pan is endless


def test_limits_apart_are_a_mistake_in_the_settings():
    with pytest.raises(ConfigError, match=r"limits\.zoom: 20000 to 30000 is outside what the camera can do"):
        common_limits(CAMERA, Limits(zoom=(20000.0, 30000.0)), None)
