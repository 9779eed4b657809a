import math
from pathlib import Path

import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from ptzd.calibration.file import dump_rig, load_provenance, load_rig, read_rig
from ptzd.errors import CalibrationError
from ptzd.geometry.head import Axis, HeadModel
from ptzd.geometry.kannala_brandt import KannalaBrandtCamera
from ptzd.geometry.perspective import PerspectiveCamera
from ptzd.geometry.rig import Rig, Uncertainty
from ptzd.geometry.sphere import rotation_from_rotvec
from ptzd.geometry.unified import UnifiedCamera
from ptzd.geometry.zoom import ZoomEntry, ZoomTable

EXAMPLE = Path(__file__).parents[2] / "config" / "rig.example.yaml"
TEXT = EXAMPLE.read_text(encoding="utf-8")


def parts(rig):
    """Everything of a rig that compares."""
    arrays = (rig.head_from_fisheye_rotation.tolist(), rig.head_from_fisheye_translation.tolist())
    return (rig.fisheye, rig.zoom, rig.head, *arrays, rig.metric, rig.uncertainty)


def with_value(path, value):
    """The example with one value replaced (or added); ``...`` removes it."""
    document = yaml.safe_load(TEXT)
    *way, last = path
    part = document
    for step in way:
        part = part[step]
    if value is ...:
        del part[last]
    else:
        part[last] = value
    return yaml.safe_dump(document)


def test_the_example_is_read():
    rig = load_rig(EXAMPLE)
    assert isinstance(rig.fisheye, UnifiedCamera)
    assert rig.fisheye.max_angle_rad == math.radians(92.0)
    assert rig.zoom.zoom_range == (1, 9999)
    assert rig.head_from_fisheye_translation.tolist() == [-0.5, -0.1, -0.05]
    assert rig.uncertainty == Uncertainty(
        rotation_rad=math.radians(0.2), translation=0.005, head_rad=math.radians(0.05)
    )
    assert load_provenance(EXAMPLE) == {"note": "an example, not measured"}


def test_what_was_read_is_written_the_same():
    rig = load_rig(EXAMPLE)
    text = dump_rig(rig, {"date": "2026-07-01"})
    assert parts(read_rig(text, "again")) == parts(rig)
    assert dump_rig(read_rig(text, "again"), {"date": "2026-07-01"}) == text


DEGREES = st.decimals(-170, 170, places=6).map(float)
NUMBERS = st.floats(-0.1, 0.1)
FOUR, FIVE = st.tuples(*[NUMBERS] * 4), st.tuples(*[NUMBERS] * 5)
PINHOLE = {
    "size_px": st.just((640, 480)),
    "fx": st.floats(250.0, 400.0),
    "fy": st.floats(250.0, 400.0),
    "cx": st.floats(300.0, 340.0),
    "cy": st.floats(220.0, 260.0),
}
FISHEYES = st.one_of(
    st.builds(UnifiedCamera, **PINHOLE, xi=st.floats(0.0, 2.0), max_angle_rad=st.floats(0.1, 0.4)),
    st.builds(UnifiedCamera, **PINHOLE, xi=st.just(1.0), distortion=FOUR, max_angle_rad=st.floats(0.1, 0.4)),
    st.builds(KannalaBrandtCamera, **PINHOLE, distortion=FOUR, max_angle_rad=st.floats(0.1, 1.0)),
    st.builds(PerspectiveCamera, **PINHOLE, distortion=FIVE),
)
AXES = st.builds(Axis, sign=st.sampled_from([-1, 1]), scale=st.floats(0.9, 1.1), offset_rad=DEGREES.map(math.radians))
RIGS = st.builds(
    Rig,
    fisheye=FISHEYES,
    zoom=st.just(
        ZoomTable(size_px=(1280, 720), entries=(ZoomEntry(zoom=1, fx=1100.1, fy=1100.2, cx=639.5, cy=359.5),))
    ),
    head=st.builds(HeadModel, pan=AXES, tilt=AXES, camera_rotvec_rad=st.tuples(*[st.floats(-0.3, 0.3)] * 3)),
    head_from_fisheye_rotation=st.tuples(*[st.floats(-1.8, 1.8)] * 3).map(lambda v: rotation_from_rotvec(np.array(v))),
    head_from_fisheye_translation=st.tuples(*[st.floats(0.01, 2.0)] * 3).map(np.array),
    metric=st.just(True),
    uncertainty=st.one_of(
        st.none(),
        st.just(Uncertainty(rotation_rad=0.001, translation=0.001, head_rad=0.0)),
    ),
)


@given(RIGS)
def test_any_rig_is_written_closely_and_from_then_on_exactly(rig):
    text = dump_rig(rig, {})
    again = read_rig(text, "again")
    assert again.head_from_fisheye_rotation == pytest.approx(rig.head_from_fisheye_rotation, abs=1e-11)
    assert (again.head_from_fisheye_translation == rig.head_from_fisheye_translation).all()
    assert again.head.camera_rotvec_rad == pytest.approx(rig.head.camera_rotvec_rad, abs=1e-11)
    assert again.head.pan == rig.head.pan
    assert type(again.fisheye) is type(rig.fisheye)
    assert again.fisheye.distortion == rig.fisheye.distortion
    assert dump_rig(again, {}) == text
    assert parts(read_rig(dump_rig(again, {}), "third")) == parts(again)


NAN, INF = math.nan, math.inf


@pytest.mark.parametrize(
    ("path", "value", "message"),
    [
        (("ptzd_calibration",), 2, "rig.yaml: ptzd_calibration: 2 instead of 1"),
        (("ptzd_calibration",), True, "rig.yaml: ptzd_calibration: True instead of 1"),
        (("ptzd_calibration",), ..., "rig.yaml: ptzd_calibration: None instead of 1"),
        (("colour",), "red", "rig.yaml: colour: unknown key"),
        (("fisheye",), ..., "rig.yaml: fisheye: missing"),
        (("fisheye",), 3, "rig.yaml: fisheye: expected `object`, got `int`"),
        (("fisheye", "fx"), ..., "rig.yaml: fisheye.fx: missing"),
        (("fisheye", "fx"), "282", "rig.yaml: fisheye.fx: expected `float`, got `str`"),
        (("fisheye", "fx"), NAN, "rig.yaml: fisheye.fx: nan is not a finite number"),
        (("fisheye", "fx"), -282.0, "rig.yaml: fisheye.fx: -282 px: the focal length must be positive"),
        (("fisheye", "fy"), -282.0, "rig.yaml: fisheye.fy: -282 px: the focal length must be positive"),
        (("fisheye", "fy"), 2820.0, "rig.yaml: fisheye.fy: 2820 px does not go with fx = 282 px"),
        (("fisheye", "cx"), 640.0, "rig.yaml: fisheye.cx: 640 px is outside the picture"),
        (("fisheye", "cy"), -1.0, "rig.yaml: fisheye.cy: -1 px is outside the picture"),
        (("fisheye", "xi"), -0.5, "rig.yaml: fisheye.xi: -0.5: the mirror parameter"),
        (("fisheye", "model"), "pinhole", "rig.yaml: fisheye.model: invalid value 'pinhole'"),
        (("fisheye", "model"), "kannala_brandt", "rig.yaml: fisheye.xi: unknown key"),
        (("fisheye", "size_px"), [640], "rig.yaml: fisheye.size_px: expected `array` of length 2, got 1"),
        (("fisheye", "size_px"), [640, 0], "rig.yaml: fisheye.size_px: [640, 0]: each side must be"),
        (("fisheye", "distortion"), [0.0, INF, 0.0, 0.0], "rig.yaml: fisheye.distortion[1]: inf is not a finite"),
        (("fisheye", "distortion"), [0.0, True, 0, 0], "rig.yaml: fisheye.distortion[1]: expected `float`, got `bool`"),
        (("fisheye", "distortion"), [-0.5, 0, 0, 0], "rig.yaml: fisheye.max_angle_deg: 92° is beyond 88.535°"),
        (("fisheye", "max_angle_deg"), 160.0, "rig.yaml: fisheye.max_angle_deg: 160° is beyond 146.385°, where the"),
        (("fisheye", "max_angle_deg"), 0.0, "rig.yaml: fisheye.max_angle_deg: 0° must be over"),
        (("ptz", "size_px"), [8, 8], "rig.yaml: ptz.size_px: [8, 8]"),
        (("ptz", "zoom"), [], "rig.yaml: ptz.zoom: empty"),
        (("ptz", "zoom", 1, "zoom"), 1, "rig.yaml: ptz.zoom[1].zoom: 1 does not come after 1"),
        (("ptz", "zoom", 0, "zoom"), 0, "rig.yaml: ptz.zoom[0].zoom: 0: VAPIX zoom starts at 1"),
        (("ptz", "zoom", 2, "fx"), 1000.0, "rig.yaml: ptz.zoom[2].fy: 2400 px does not go with fx = 1000 px"),
        (("ptz", "zoom", 1, "fx"), 554.0, "rig.yaml: ptz.zoom[1].fy"),
        (("ptz", "zoom", 4, "distortion"), [-900.0, 0, 0, 0, 0], "rig.yaml: ptz.zoom[4].distortion: folds back"),
        (("ptz", "zoom", 4, "gain"), 1, "rig.yaml: ptz.zoom[4].gain: unknown key"),
        (("head", "pan", "sign"), 0, "rig.yaml: head.pan.sign: 0 must be 1 or -1"),
        (("head", "tilt", "scale"), -1.0, "rig.yaml: head.tilt.scale: -1 must be 0.5 to 2"),
        (("head", "tilt", "offset_deg"), 400.0, "rig.yaml: head.tilt.offset_deg: 400° is over a whole turn"),
        (("head", "camera_rotvec_deg"), [0, 0, 200.0], "rig.yaml: head.camera_rotvec_deg: its length 200°"),
        (("head", "camera_rotvec_deg"), [0, 60.0, 0], "rig.yaml: head.camera_rotvec_deg: the optical axis is over 45°"),
        (("rig", "rotvec_deg"), [0, 0, 181.0], "rig.yaml: rig.rotvec_deg: its length 181° is over 180°"),
        (("rig", "translation_m"), [0, 0, 0], "rig.yaml: rig.translation_m: zero"),
        (("rig", "translation_m"), [-500.0, 0, 0], "rig.yaml: rig.translation_m: 500 m between the cameras"),
        (("rig", "metric"), False, "rig.yaml: rig.translation_m: its length 0.512347538 must be 1"),
        (("rig", "metric"), 1, "rig.yaml: rig.metric: expected `bool`, got `int`"),
        (("uncertainty", "rotation_deg"), -0.1, "rig.yaml: uncertainty.rotation_deg: -0.1° must be 0° to 45°"),
        (("uncertainty", "translation_m"), 3.0, "rig.yaml: uncertainty.translation_m: 3 must be 0 to the baseline"),
    ],
)
def test_every_refusal_names_its_culprit(path, value, message):
    with pytest.raises(CalibrationError) as refused:
        read_rig(with_value(path, value), "rig.yaml")
    assert str(refused.value).startswith(message)
    assert "\n" not in str(refused.value)


def test_a_zoom_entry_must_look_closer():
    document = yaml.safe_load(TEXT)
    document["ptz"]["zoom"][1] |= {"fx": 554.3, "fy": 554.3}
    with pytest.raises(CalibrationError, match=r"ptz\.zoom\[1\]\.fx: 554\.3 px at a longer zoom"):
        read_rig(yaml.safe_dump(document), "rig.yaml")
    document["ptz"]["zoom"] = document["ptz"]["zoom"][:2]
    document["ptz"]["zoom"][0] |= {"cx": 0.0}
    document["ptz"]["zoom"][1] |= {"fx": 560.0, "fy": 560.0}
    with pytest.raises(CalibrationError, match=r"ptz\.zoom\[1\]\.fx: the field of view does not shrink"):
        read_rig(yaml.safe_dump(document), "rig.yaml")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "rig.yaml: ptzd_calibration: None"),
        ("[1, 2]", "rig.yaml: ptzd_calibration: None"),
        ("a: [1, 2", "rig.yaml: line 1, column 9: "),
        (
            "ptzd_calibration: 1\nptzd_calibration: 1",
            "rig.yaml: line 2, column 1: key 'ptzd_calibration' is given twice",
        ),
        ("a: \x07", "rig.yaml: not YAML: "),
        ("a: 2026-99-99", "rig.yaml: ptzd_calibration: None instead of 1"),
        ("? [1]\n: 2", "rig.yaml: line 1"),
        ("ptzd_calibration: 1\n1: 2", "rig.yaml: "),
    ],
)
def test_what_is_no_calibration_is_refused_in_one_line(text, message):
    with pytest.raises(CalibrationError) as refused:
        read_rig(text, "rig.yaml")
    assert str(refused.value).startswith(message)
    assert "\n" not in str(refused.value)


def test_numbers_with_an_exponent_are_numbers():
    text = TEXT.replace("translation_m: 0.005", "translation_m: 5e-3")
    assert read_rig(text, "rig.yaml").uncertainty.translation == 0.005


def test_what_may_be_left_out():
    document = yaml.safe_load(TEXT)
    del document["uncertainty"], document["provenance"], document["head"]["camera_rotvec_deg"]
    rig = read_rig(yaml.safe_dump(document), "rig.yaml")
    assert rig.uncertainty is None
    assert rig.head.camera_rotvec_rad == (0.0, 0.0, 0.0)
    assert "uncertainty" not in dump_rig(rig, {})


def test_files_that_cannot_be_read(tmp_path):
    with pytest.raises(CalibrationError, match=r"nowhere\.yaml: cannot be read: No such file"):
        load_rig(tmp_path / "nowhere.yaml")
    latin = tmp_path / "latin.yaml"
    latin.write_bytes(b"note: \xe9")
    with pytest.raises(CalibrationError, match=r"latin\.yaml: no UTF-8 text, at byte 6"):
        load_rig(str(latin))
    with pytest.raises(CalibrationError, match=r"nowhere\.yaml: cannot be read"):
        load_provenance(tmp_path / "nowhere.yaml")


def test_what_cannot_be_written_is_refused():
    rig = load_rig(EXAMPLE)
    with pytest.raises(CalibrationError, match="provenance: only plain values"):
        dump_rig(rig, {"sigma": np.float64(0.1)})

    class Strange:
        size_px = (640, 480)

    values = {name: getattr(rig, name) for name in Rig.__slots__}
    with pytest.raises(CalibrationError, match=r"fisheye\.model: a Strange has no name"):
        dump_rig(Rig(**values | {"fisheye": Strange()}), {})
