from __future__ import annotations

import json
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ptzd.devices.vapix import answers
from ptzd.devices.vapix.answers import CameraSaysNo, Reply
from ptzd.errors import DeviceError, DeviceGarbled, DeviceRefused
from ptzd.model import HeadReading

DATA = Path(__file__).parents[2] / "data" / "axis_http"


def reply(text: str, status: int = 200, content_type: str = "text/plain") -> Reply:
    return Reply(status=status, content_type=content_type, text=text)


@pytest.mark.parametrize(
    ("text", "pose"),
    [
        (
            "pan=51.2891\r\ntilt=46.1914\r\nzoom=1\r\niris=6427\r\nfocus=8265\r\nautofocus=off\r\n",
            (51.2891, 46.1914, 1),
        ),
        ("pan=121.8465\ntilt=-2.1260\nzoom=1\nautofocus=on\nautoiris=on\n", (121.8465, -2.126, 1)),
        ("zoom=4\r\niris=5748\r\ntilt=-45.03\r\nmystery\r\npan=-0.01", (-0.01, -45.03, 4)),
    ],
)
def test_positions_of_real_cameras(text, pose):
    assert answers.position(reply(text)) == HeadReading(pan_deg=pose[0], tilt_deg=pose[1], zoom=pose[2])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("tilt=1\r\nzoom=1\r\n", "lacks pan="),
        ("Pan=1\ntilt=1\nzoom=1", "lacks pan="),
        ("pan=nan\ntilt=1\nzoom=1", "pan='nan' is no number"),
        ("pan=inf\ntilt=1\nzoom=1", "pan='inf' is no number"),
        ("pan=1\ntilt=n/a#\nzoom=1", "tilt='n/a#' is no number"),
        ("pan=1\ntilt=1\nzoom=99999", "zoom='99999' is no number between 0 and 20000"),
        ("", "no key at all"),
        ("<html><body>busy</body></html>", "got HTML"),
    ],
)
def test_positions_that_are_none(text, message):
    with pytest.raises(DeviceGarbled, match=message):
        answers.position(reply(text))


@pytest.mark.parametrize("text", ["Error:\r\nquery: unknown value: foo\r\n", "\nError: PTZ disabled", "# Error: x"])
@pytest.mark.parametrize(
    "parse", [answers.position, answers.limits, answers.speed, answers.accepted, answers.attributes]
)
def test_an_error_inside_a_200_is_a_no(parse, text):
    with pytest.raises(CameraSaysNo, match=r"the camera says: '.*Error:?"):
        parse(reply(text))


@pytest.mark.parametrize(("status", "text"), [(204, ""), (200, ""), (200, "\r\n")])
def test_a_command_is_accepted_by_silence(status, text):
    answers.accepted(reply(text, status))


def test_a_command_answered_with_a_page_is_not_accepted():
    with pytest.raises(DeviceGarbled, match="expected an empty answer"):
        answers.accepted(reply("<html>login</html>", content_type="text/html"))


LIMITS = "MinPan=-170\r\nMaxPan=170\r\nMinTilt=-20\r\nMaxTilt=90\r\nMinZoom=1\r\nMaxZoom=9999\r\n"


def test_limits_with_a_lens():
    found = answers.limits(reply(LIMITS + "MinFieldAngle=22\r\nMaxFieldAngle=623\r\n"))
    assert (found.pan_deg, found.tilt_deg, found.zoom, found.hfov_deg) == (
        (-170, 170),
        (-20, 90),
        (1, 9999),
        (2.2, 62.3),
    )


@pytest.mark.parametrize("angles", ["", "MinFieldAngle=1\nMaxFieldAngle=100\n", "MinFieldAngle=x\nMaxFieldAngle=1\n"])
def test_dummy_field_angles_are_no_lens(angles):
    assert answers.limits(reply(LIMITS + angles)).hfov_deg is None


@pytest.mark.parametrize("swap", [("MaxPan=170", "MaxPan=-171"), ("MaxZoom=9999", "MaxZoom=1")])
def test_limits_in_the_wrong_order(swap):
    with pytest.raises(DeviceGarbled, match="wrong order"):
        answers.limits(reply(LIMITS.replace(*swap)))


def test_limits_of_a_channel_that_only_zooms():
    with pytest.raises(DeviceGarbled, match=r"limits lack MinPan, MaxPan.*ptz\.camera"):
        answers.limits(reply("MinZoom=1\r\nMaxZoom=9999\r\n"))


@pytest.mark.parametrize("path", sorted(DATA.glob("*.txt")), ids=lambda path: path.stem)
def test_every_recorded_parameter_list_is_read(path):
    text = path.read_text(encoding="utf-8")
    found = answers.parameters(reply(text))
    assert len(found.values) == sum("=" in line for line in text.splitlines())
    assert not any(name.startswith("root.") for name in found.values)


def test_parameters_by_name():
    text = (DATA / "ptz__PTZ_RESPONSE.txt").read_text(encoding="utf-8")
    found = answers.parameters(reply(text))
    assert found.get("PTZ.Limit.L1.MaxFieldAngle") == "623"
    assert found.get("PTZ.Preset.P0.Position.P1.Name") == "Entrée"
    assert found.matching("PTZ.UserCtlQueue.", ".UserGroup")["PTZ.UserCtlQueue.U1.UserGroup"] == "Operator"


def test_a_group_that_the_camera_does_not_have_costs_only_itself():
    text = "root.Brand.Brand=AXIS\r\n# Error: Error -1 getting param in group 'root.PTZ'\r\n"
    assert answers.parameters(reply(text)).values == {"Brand.Brand": "AXIS"}
    with pytest.raises(CameraSaysNo):
        answers.parameters(reply(text.partition("\r\n")[2]))


def test_recorded_json():
    found = answers.device_info(reply((DATA / "basic_device_info__GET_ALL_PROPERTIES_RESPONSE.json").read_text()))
    assert (found.product, found.firmware, found.serial) == ("AXIS M1065-LW Network Camera", "9.80.1", "ACCC12345678")
    for name in ("api_discovery__GET_API_LIST_RESPONSE", "api_discovery__GET_SUPPORTED_VERSIONS_RESPONSE"):
        with pytest.raises(DeviceGarbled, match=r"lacks data\.propertyList"):
            answers.device_info(reply((DATA / f"{name}.json").read_text()))


def test_attributes_of_the_documentation():
    text = (
        '{"Camera 1":{"maxOpticalZoomMag":"30","zoomSteps":[{"value":"1","zoom":"1"},{"value":"3868","zoom":"2"}],'
        '"speeds":[{"value":"1","speed":"0.05"},{"value":"100","speed":"150"}]}}'
    )
    found = answers.attributes(reply(text, content_type="application/json"))
    assert found.max_speed_deg_s == 150
    assert found.zoom_steps == ((1, 1), (3868, 2))


def test_system_state():
    assert answers.system_state(reply('{"data":{"systemready":"yes","bootid":"a"}}')).boot_id == "a"
    assert not answers.system_state(reply('{"data":{"systemready":"no"}}')).ready
    with pytest.raises(DeviceRefused, match="Invalid method"):
        answers.system_state(reply('{"error":{"code":2004,"message":"Invalid method"}}'))


PARSERS = [
    answers.accepted, answers.position, answers.limits, answers.speed, answers.parameters, answers.attributes,
    answers.device_info, answers.system_state, answers.session_token,
]  # fmt: skip


JSON = st.recursive(
    st.none() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=3), inner, max_size=3),
    max_leaves=5,
).map(lambda value: json.dumps({"data": value, "Camera 1": value}))


@given(st.text(max_size=100) | JSON)
@settings(max_examples=50)
@pytest.mark.parametrize("parse", PARSERS)
def test_any_text_is_an_answer_or_a_named_error(parse, text):
    message = ""
    try:
        parse(reply(text))
    except DeviceError as error:
        message = str(error)
    assert "\n" not in message
    assert len(message) < 1000
