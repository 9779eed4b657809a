import json
import math

import pytest

from ptzd.sim.auth import User
from ptzd.sim.clock import VirtualClock
from ptzd.sim.head import MoveBy, MoveTo, Pose, Turn, ZoomRun
from ptzd.sim.ptz_cgi import Reply, answer, configure
from ptzd.sim.ptz_request import PtzSyntax, parse
from ptzd.sim.settings import SimSettings
from ptzd.sim.unit import Unit

USER = User(name="ptzd", password="x")


def ask(unit: Unit, **arguments: object) -> Reply:
    return answer(unit, parse([(name, str(value)) for name, value in arguments.items()]), USER)


def settle(unit: Unit, clock: VirtualClock) -> Pose:
    while unit.head.busy(clock.now_s()):
        clock.advance(0.1)
    clock.advance(1.0)
    return unit.head.encoder(clock.now_s())


@pytest.mark.parametrize(("arguments", "order"), [
    ({"pan": "10", "tilt": "-5.5", "zoom": "500"}, MoveTo(pan=10, tilt=-5.5, zoom=500)),
    ({"pan": "0", "camera": "1"}, MoveTo(pan=0)),
    ({"zoom": "500.9"}, MoveTo(zoom=500)),
    ({"rpan": "-30.25"}, MoveBy(pan=-30.25)),
    ({"rzoom": "-200"}, MoveBy(zoom=-200)),
    ({"continuouszoommove": "-20"}, ZoomRun(percent=-20)),
    ({"continuouspantiltmove": "10,-5"}, Turn(pan_percent=10, tilt_percent=-5, proportional=2.0)),
    ({"continuouspantiltmove": "10.5,0", "proportionalspeed": "disabled"}, Turn(pan_percent=10.5, tilt_percent=0)),
    ({"move": "stop"}, Turn(pan_percent=0, tilt_percent=0)),
    ({"pan": "10", "html": "no", "timestamp": "1700000000"}, MoveTo(pan=10)),
])  # fmt: skip
def test_a_command_gives_204_and_one_order(unit, arguments, order):
    assert ask(unit, **arguments) == Reply(status=204, text="")
    assert [record.order for record in unit.orders] == [order]


@pytest.mark.parametrize(("name", "text"), [
    ("pan", "abc"), ("pan", "nan"), ("pan", "inf"), ("pan", ""), ("pan", "180.1"), ("tilt", "-181"), ("zoom", "0"),
    ("zoom", "10000"), ("zoom", "nan"), ("rpan", "361"), ("rzoom", "10000"), ("speed", "0"), ("speed", "101"),
    ("move", "sideways"), ("center", "1"), ("center", "1,2,3"), ("areazoom", "1,2,0"), ("imagerotation", "45"),
    ("continuouspantiltmove", "101,0"), ("continuouspantiltmove", "10"), ("continuouszoommove", "x"),
    ("autofocus", "maybe"), ("camera", "2"), ("camera", "0"), ("camera", "all"), ("focus", "0"), ("whoami", "2"),
    ("pzmoving", "1"), ("query", "foo"), ("query", "position,foo"), ("gotoserverpresetno", "0"),
])  # fmt: skip
def test_what_is_out_of_range_or_unknown_is_refused_by_name(name, text):
    with pytest.raises(PtzSyntax, match=f"^{name}: "):
        parse([(name, text)])


def test_the_wording_of_an_unknown_query_is_the_cameras():
    with pytest.raises(PtzSyntax, match=r"^query: unknown value: foo$"):
        parse([("query", "foo")])


def test_targets_beyond_the_limits_are_clamped_without_a_word(unit, clock):
    assert ask(unit, pan=180, tilt=-90).status == 204
    pose = settle(unit, clock)
    assert (pose.pan_deg, pose.tilt_deg) == (170, -20)


@pytest.mark.parametrize(("name", "keys", "decimals"), [
    ("v5915", ["pan", "tilt", "zoom", "iris", "focus", "brightness", "autofocus", "autoiris"], 4),
    ("dome", ["pan", "tilt", "zoom", "autofocus", "autoiris"], 4),
    ("old214", ["pan", "tilt", "zoom", "iris", "focus", "autofocus", "autoiris"], 2),
])  # fmt: skip
def test_position_has_the_profiles_keys_order_decimals_and_grid(name, keys, decimals):
    clock = VirtualClock()
    unit = Unit(SimSettings(profile=name), clock)
    ask(unit, pan=51.2891, tilt=-17.3, zoom=460)
    settle(unit, clock)
    text = ask(unit, query="position").text
    assert text.endswith("\r\n")
    pairs = [line.split("=") for line in text.splitlines()]
    assert [key for key, _ in pairs] == keys
    values = dict(pairs)
    assert len(values["pan"].split(".")[1]) == decimals
    assert values["zoom"] == "460"
    assert abs(float(values["pan"]) - 51.2891) < 0.006
    if name == "v5915":
        assert values["pan"] == "51.2891"
        assert float(values["tilt"]) * 256 == pytest.approx(round(float(values["tilt"]) * 256), abs=0.02)


def test_limits_are_the_recorded_ones_of_this_class(unit):
    expected = (
        "MinPan=-170 MaxPan=170 MinTilt=-20 MaxTilt=90 MinZoom=1 MaxZoom=9999 MinIris=1 MaxIris=9999 MinFocus=770 "
        "MaxFocus=9999 MinFieldAngle=22 MaxFieldAngle=623 MinBrightness=1 MaxBrightness=9999"
    )
    assert ask(unit, query="limits").text.split() == expected.split()


def test_several_queries_in_one_request(unit):
    text = ask(unit, query="position,limits").text
    assert text.startswith("pan=")
    assert "MaxZoom=9999" in text


def test_speed_sticks_and_mode_is_normal(unit):
    assert ask(unit, speed=42, pan=3).status == 204
    assert ask(unit, query="speed").text == "speed=42\r\n"
    assert ask(unit, query="mode").text == "mode=normal\r\n"


def test_whoami_and_info(unit):
    assert ask(unit, whoami=1).text == "Sony_camblock\r\n"
    info = ask(unit, info=1).text.split("\r\n")
    assert info[:3] == ["Available commands", ":", "{camera=[n]}"]


def test_attributes_tell_the_zoom_steps_with_strings_in_json(unit):
    document = json.loads(ask(unit, query="attributes", format="json").text)["Camera 1"]
    assert document["zoomSteps"][0] == {"value": "1", "zoom": "1"}
    assert document["zoomSteps"][-1]["value"] == "9999"
    steps = {entry["zoom"]: int(entry["value"]) for entry in document["zoomSteps"]}
    top = float(document["zoomSteps"][-1]["zoom"])
    assert steps["10"] == pytest.approx(1 + 9 * 9998 / (top - 1), abs=1)


def test_an_old_camera_has_no_attributes():
    unit = Unit(SimSettings(profile="old214"), VirtualClock())
    assert ask(unit, query="attributes").text.startswith("Error:\r\n")


def test_a_disabled_driver_answers_with_an_error(unit):
    unit.parameters["PTZ.ImageSource.I0.PTZEnabled"] = "false"
    assert ask(unit, pan=3).text == "Error:\r\nPTZ disabled\r\n"
    assert ask(unit, whoami=1).text == "PTZ disabled\r\n"
    assert not unit.orders


def test_a_locked_unit_accepts_and_does_nothing_and_a_disabled_axis_stays(unit):
    unit.parameters["PTZ.Various.V1.Locked"] = "true"
    assert ask(unit, pan=3).status == 204
    assert not unit.orders
    unit.parameters |= {"PTZ.Various.V1.Locked": "false", "PTZ.Various.V1.PanEnabled": "false"}
    ask(unit, pan=3, tilt=4)
    assert unit.orders[-1].order == MoveTo(tilt=4)


def test_presets_are_kept_found_reached_renamed_and_forgotten(unit, clock):
    ask(unit, pan=33, tilt=5, zoom=700)
    settle(unit, clock)
    ask(unit, setserverpresetname="Entrée")
    assert "presetposno2=Entrée" in ask(unit, query="presetposall").text
    assert "tilt=5.000000:focus=32766.000000:pan=33.000000" in unit.parameters["PTZ.Preset.P0.Position.P2.Data"]
    ask(unit, move="home")
    assert settle(unit, clock) == Pose(pan_deg=0, tilt_deg=0, zoom=1)
    ask(unit, gotoserverpresetname="Entrée")
    assert settle(unit, clock) == Pose(pan_deg=33, tilt_deg=5, zoom=700)
    assert configure(unit, {"renameserverpresetno": "2", "newname": "Tor"}).status == 204
    assert ask(unit, gotoserverpresetname="Entrée").text.startswith("Error:")
    assert configure(unit, {"removeserverpresetno": "2"}).status == 204
    assert ask(unit, gotoserverpresetno=2).text == "Error:\r\ngotoserverpresetno: invalid value\r\n"


@pytest.mark.parametrize("name", ["a:b", "<a>", '"', "~", "x" * 32])
def test_names_that_no_preset_may_have(unit, name):
    assert ask(unit, setserverpresetname=name).text.startswith("Error:")
    assert configure(unit, {"setserverpresetname": name}).text.startswith("Error:")


def test_presets_work_while_an_axis_is_disabled(unit, clock):
    unit.parameters["PTZ.Various.V1.PanEnabled"] = "false"
    unit.presets[1] = type(unit.presets[1])(name="Home", pan=12, tilt=0, zoom=1)
    ask(unit, move="home")
    assert settle(unit, clock).pan_deg == 12


@pytest.mark.parametrize(("point", "pan", "tilt"), [((320, 240), 0, 0), ((640, 240), 31.15, 0), ((320, 0), 0, 24.38)])
def test_centre_moves_by_the_angle_of_the_pixel(unit, clock, point, pan, tilt):
    ask(unit, center=f"{point[0]},{point[1]}", imagewidth=640, imageheight=480)
    pose = settle(unit, clock)
    assert pose.pan_deg == pytest.approx(pan, abs=0.01)
    assert pose.tilt_deg == pytest.approx(tilt, abs=0.01)


def test_areazoom_300_shows_a_third(unit, clock):
    ask(unit, areazoom="320,240,300", imagewidth=640, imageheight=480)
    pose = settle(unit, clock)
    assert 1 + (pose.zoom - 1) * (unit.profile.max_magnification - 1) / 9998 == pytest.approx(3, abs=0.01)


def test_a_step_goes_a_quarter_of_the_picture(unit, clock):
    ask(unit, move="upright")
    pose = settle(unit, clock)
    assert pose.pan_deg == pytest.approx(62.3 / 4, abs=0.01)
    assert pose.tilt_deg == pytest.approx(62.3 / 4, abs=0.01)


def test_a_turned_picture_turns_the_steps(unit, clock):
    ask(unit, move="right", imagerotation=180)
    assert settle(unit, clock).pan_deg == pytest.approx(-62.3 / 4, abs=0.01)


def test_focus_needs_autofocus_off(unit):
    ask(unit, focus=1000)
    assert unit.levels["focus"] == 8265
    ask(unit, autofocus="off", focus=1000, rbrightness=-100)
    assert unit.levels == {"iris": 6427, "focus": 1000, "brightness": 4899}


def test_endless_cameras_tell_their_limits_as_180():
    unit = Unit(SimSettings(profile="dome"), VirtualClock())
    values = dict(line.split("=") for line in ask(unit, query="limits").text.splitlines())
    assert (values["MinPan"], values["MaxPan"]) == ("-180", "180")
    assert "MinIris" not in values
    assert math.isclose(unit.profile.max_magnification, 36.6, rel_tol=0.01)


def test_attributes_in_plain_text_have_the_speed_table_by_group(unit):
    speeds = ask(unit, query="attributes", group="speed").text.splitlines()
    assert speeds[:4] == ["value=1", "speed=0.05", "value=9", "speed=0.16"]
    assert "maxOpticalZoomMag=31" in ask(unit, query="attributes", group="zoom").text.splitlines()
    linear = Unit(SimSettings(profile="dome"), VirtualClock())
    assert "speed=150" in ask(linear, query="attributes").text.splitlines()


def test_presets_in_other_forms(unit):
    assert json.loads(ask(unit, query="presetposall", format="json").text) == {
        "Camera 1": {"presets": [{"number": "1", "name": "Home"}]}
    }
    assert ask(unit, query="presetposcam").text == "Preset Positions for camera 1\r\npresetposno1=Home\r\n"
    assert "presetposno1=Home:tilt=0.000000:" in ask(unit, query="presetposcamdata", camera="all").text
    assert ask(unit, query="auxiliary").status == 200


@pytest.mark.parametrize(("arguments", "refused"), [
    ({"setserverpresetno": "7"}, None),
    ({"setserverpresetno": "x"}, "setserverpresetno: invalid value"),
    ({"setserverpresetno": "257"}, "setserverpresetno: invalid value"),
    ({"removeserverpresetno": "9"}, "removeserverpresetno: preset not found"),
    ({"removeserverpresetname": "Nope"}, "removeserverpresetname: preset not found"),
    ({"renameserverpresetno": "9", "newname": "a"}, "renameserverpresetno: preset not found"),
    ({"renameserverpresetno": "1"}, "newname: invalid value"),
    ({"setserverpresetname": "Gate", "home": "yes"}, None),
    ({"setserverpresetname": "Gate", "camera": "1"}, None),
])  # fmt: skip
def test_preset_configuration(unit, arguments, refused):
    reply = configure(unit, arguments)
    if refused is None:
        assert (reply.status, len(unit.presets)) == (204, 2)
    else:
        assert reply.text.startswith("Error:\r\n")
        assert refused in reply.text


def test_all_presets_but_home_can_be_forgotten_at_once(unit):
    for name in ("a", "b"):
        ask(unit, setserverpresetname=name)
    configure(unit, {"removeallserverpresets": "yes"})
    assert set(unit.presets) == {1}


def test_an_order_by_number_and_a_device_preset(unit, clock):
    ask(unit, pan=8)
    settle(unit, clock)
    ask(unit, setserverpresetno=5)
    ask(unit, pan=0)
    settle(unit, clock)
    assert ask(unit, gotoserverpresetno=5).status == 204
    assert settle(unit, clock).pan_deg == 8
    assert ask(unit, removeserverpresetno=5).status == 204
    assert ask(unit, removeserverpresetname="Preset 5").text.startswith("Error:")
    assert ask(unit, gotodevicepreset=1).text.startswith("Error:")


def test_switches_of_the_picture(unit):
    assert ask(unit, ircutfilter="on", backlight="on", autoiris="off", iris=100).status == 204
    assert unit.parameters["PTZ.Various.V1.IrCutFilter"] == "on"
    assert unit.parameters["PTZ.Various.V1.BackLight"] == "true"
    assert unit.levels["iris"] == 100
