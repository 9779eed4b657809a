"""The rig as a whole: truth, calibration, fisheye, scripts."""

import asyncio
import math
from pathlib import Path

import aiohttp
import cv2
import numpy as np
import pytest
from msgspec import UNSET

from ptzd.calibration.file import read_rig
from ptzd.errors import SimulationError
from ptzd.geometry.types import pixel_angle_rad
from ptzd.model import HeadReading
from ptzd.sim.auth import Role
from ptzd.sim.faults import Fault, FaultKind
from ptzd.sim.optics import camera_at
from ptzd.sim.profile import PROFILES
from ptzd.sim.rig import SimRig, serve
from ptzd.sim.rig_truth import calibration_text, direction, fisheye_camera, head_model
from ptzd.sim.scene import load_scene
from ptzd.sim.script import CameraChanges, read_script
from ptzd.sim.settings import CalibrationError, SimSettings


def handed_out(room, **changes: object):
    settings = SimSettings(**changes)
    kind = PROFILES[settings.profile]
    text = calibration_text(settings, room, fisheye_camera(room.camera, None), kind)
    return read_rig(text, "rig.yaml"), kind, settings


@pytest.mark.parametrize("name", sorted(PROFILES))
def test_the_calibration_states_the_true_lens_between_its_zooms_too(room, name):
    rig, kind, settings = handed_out(room, profile=name)
    assert len(rig.zoom.entries) >= 5
    for zoom in np.unique(np.geomspace(1, 9999, 60).round()).tolist():
        true, stated = camera_at(kind, zoom, settings.ptz_size_px), rig.zoom.camera_at(zoom)
        assert stated.fx / true.fx == pytest.approx(1, abs=1e-3)
        corner = np.array([0.0, 0.0])
        off = np.arccos(np.clip((true.lift(corner)[0] * stated.lift(corner)[0]).sum(), -1, 1))
        assert off < 0.5 * pixel_angle_rad(true, np.array([320.0, 240.0]))


def test_the_true_lens_is_not_what_a_client_would_assume(room):
    for name in PROFILES:
        rig, kind, _ = handed_out(room, profile=name)
        wide = math.radians(kind.field_angle[1] / 10)
        ratios = []
        for zoom in (1000, 3000, 5000):
            assumed = 319.5 / math.tan(wide / 2) * (1 + (zoom - 1) * (kind.max_magnification - 1) / 9998)
            ratios.append(rig.zoom.camera_at(zoom).fx / assumed)
        assert max(abs(ratio - 1) for ratio in ratios) > 0.01


def test_errors_of_the_calibration_are_stated_as_asked_for(room):
    wrong = CalibrationError(
        rotation_deg=(0.5, 0.0, 0.0), translation_m=(0.01, 0.0, 0.0), pan_offset_deg=0.2, focal_share=0.01
    )
    true, _, _ = handed_out(room)
    rig, _, _ = handed_out(room, calibration=wrong)
    turn = rig.head_from_fisheye_rotation @ true.head_from_fisheye_rotation.T
    assert math.degrees(math.acos((np.trace(turn) - 1) / 2)) == pytest.approx(0.5, abs=1e-6)
    assert rig.head_from_fisheye_translation[0] - true.head_from_fisheye_translation[0] == pytest.approx(0.01)
    assert math.degrees(rig.head.pan.offset_rad - true.head.pan.offset_rad) == pytest.approx(0.2)
    assert rig.zoom.camera_at(1).fx / true.zoom.camera_at(1).fx == pytest.approx(1.01)


@pytest.mark.parametrize("name", sorted(PROFILES))
async def test_the_head_told_the_true_direction_has_the_target_on_its_axis(start, room, name):
    """Truth → camera degrees → calibration: the optical axis points at the surface that the fisheye sees."""
    visitor = await start(profile=name, fisheye_size_px=None)
    calibration = read_rig((await visitor.get(f"{visitor.rig.truth_url}/truth/calibration")).text, "rig.yaml")
    for box in room.demo_boxes:
        x, y = box.centre_px
        truth = await visitor.truth("/truth/direction", x=x, y=y)
        reading = HeadReading(**truth["vapix"])
        axis = calibration.head_from_camera(reading)[:, 2]
        assert np.degrees(np.arccos(np.clip(axis @ np.array(truth["bearing_head"]), -1, 1))) < 1e-4
        ray, _ = calibration.fisheye.lift(np.array([x, y]))
        point = calibration.head_from_fisheye_rotation @ ray * truth["range_m"]
        point = point + calibration.head_from_fisheye_translation
        off = np.cross(point / np.linalg.norm(point), truth["bearing_head"])
        assert np.linalg.norm(off) < 1e-6


async def test_truth_refuses_what_it_cannot_say(visitor):
    for query in ({"x": 0, "y": 0}, {"x": "a", "y": 1}, {}):
        async with visitor.side.get(visitor.rig.truth_url + "/truth/direction", params=query) as reply:
            assert reply.status in (400, 404)
            assert "error" in await reply.json()


async def test_truth_knows_the_past_and_is_no_part_of_the_camera(visitor):
    await visitor.ptz(pan=20)
    await visitor.rest()
    now = await visitor.truth("/truth/pose")
    then = await visitor.truth("/truth/pose", t_ns=now["t_ns"] - int(1e9))
    assert now["encoder"]["pan_deg"] == 20
    assert now["rest_ns"] < now["t_ns"]
    assert now["hfov_deg"] == pytest.approx(62.3, abs=0.5)
    assert then["t_ns"] == pytest.approx(now["t_ns"] - 1e9, abs=1e3)
    assert (await visitor.get("/truth/pose")).status == 404


async def test_a_fault_can_be_ordered_over_the_side_channel(visitor):
    url = visitor.rig.truth_url + "/truth/fault"
    async with visitor.side.post(url, json={"kind": "status", "status": 503, "path": "*ptz.cgi*"}) as reply:
        assert reply.status == 200
    assert (await visitor.ptz(query="speed")).status == 503
    async with visitor.side.delete(url) as reply:
        assert reply.status == 200
    assert (await visitor.ptz(query="speed")).status == 200
    async with visitor.side.post(url, json={"kind": "nonsense"}) as reply:
        assert reply.status == 400


async def test_the_fisheye_streams_the_scene_through_its_lens(start, room):
    visitor = await start(fisheye_fps=20.0, fisheye_noise_sigma=0.0, fisheye_size_px=None)
    async with visitor.side.get(visitor.rig.fisheye_url) as reply:
        assert reply.headers["Content-Type"] == "multipart/x-mixed-replace; boundary=myboundary"
        body = b""
        while body.count(b"--myboundary") < 3:
            body += await reply.content.readany()
    jpeg = body[body.index(b"\xff\xd8") : body.index(b"\r\n--myboundary", 10)]
    picture = cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_COLOR)
    assert picture.shape == (480, 640, 3)
    rays, valid = visitor.rig.fisheye_camera.lift(np.array([[[0.0, 0.0], [320.0, 240.0]]]))
    assert valid.tolist() == [[False, True]]
    assert picture[0, 0].max() < 12
    expected = room.sample_fisheye(np.repeat(rays[:, 1:], 9, axis=1).reshape(3, 3, 3), np.ones((3, 3), bool))
    assert np.abs(expected[1, 1].astype(int) - picture[240, 320]).max() < 60


async def test_an_unplugged_fisheye_is_gone_and_comes_back(visitor):
    fisheye = visitor.rig.fisheye
    async with visitor.side.get(visitor.rig.fisheye_url) as reply:
        await reply.content.readany()
        await fisheye.unplug()
        with pytest.raises(aiohttp.ClientConnectionError):
            await visitor.get(visitor.rig.fisheye_url)
    await fisheye.plug_in()
    async with visitor.side.get(visitor.rig.fisheye_url) as reply:
        assert await reply.content.readany()


@pytest.mark.parametrize("kind", [FaultKind.RESET, FaultKind.STATUS, FaultKind.HANG])
async def test_faults_reach_the_fisheye_by_name(visitor, kind):
    visitor.rig.inject(Fault(kind=kind, device="fisheye", status=500))
    assert (await visitor.ptz(query="speed")).status == 200
    try:
        async with asyncio.timeout(0.3):
            status = (await visitor.get(visitor.rig.fisheye_url.replace("mjpg", "jpg"))).status
    except (aiohttp.ClientConnectionError, TimeoutError):
        status = 0
    assert status != 200
    visitor.rig.fisheye.faults.clear()
    assert (await visitor.get(visitor.rig.fisheye_url.replace("mjpg", "jpg"))).status == 200


@pytest.mark.parametrize("device", ["ptz", "fisheye"])
async def test_an_unplugged_device_refuses_for_its_time_and_is_then_as_before(start, clock, device):
    visitor = await start(clock=clock)
    if device == "ptz":
        await visitor.ptz(pan=7)
        clock.advance(30.0)
    url = visitor.rig.fisheye_url.replace("mjpg", "jpg") if device == "fisheye" else "/axis-cgi/com/ptz.cgi?query=speed"

    async def until_it_says(kind: object) -> None:
        said: object = None
        while said != kind:
            clock.advance(0.01)
            try:
                said = (await visitor.get(url)).status
            except aiohttp.ClientConnectionError:
                said = "refused"
            assert said in {200, "refused"}

    visitor.rig.inject(Fault(kind=FaultKind.UNPLUG, device=device, for_s=0.4))
    await until_it_says("refused")
    clock.advance(0.3)
    await until_it_says("refused")
    clock.advance(0.2)
    await until_it_says(200)
    if device == "ptz":
        assert (await visitor.position())["pan"] == 7


async def test_a_script_of_faults_is_played(start, tmp_path):
    script = tmp_path / "faults.yaml"
    script.write_text("- {kind: foreign_move, pan: 5}\n- {kind: status, status: 503, at_s: 0.2, path: '*speed*'}\n")
    visitor = await start(faults=str(script))
    await visitor.until(lambda: bool(visitor.rig.camera.unit.orders))
    async with asyncio.timeout(100):
        while (await visitor.ptz(query="speed")).status == 200:
            pass


EXAMPLE = Path(__file__).parents[2] / "config" / "faults.example.yaml"


def test_the_example_shows_every_key_and_every_kind_of_fault():
    script = read_script(str(EXAMPLE))
    assert {fault.kind for fault in script.faults} == set(FaultKind)
    assert not [name for name in CameraChanges.__struct_fields__ if getattr(script.camera, name) is UNSET]


async def test_the_example_makes_the_camera_that_it_describes(start):
    visitor = await start(faults=str(EXAMPLE))
    rig = visitor.rig
    assert (rig.camera.unit.profile.name, rig.camera.unit.settings.role) == ("dome", Role.OPERATOR)
    assert rig.camera.certificate is not None
    assert rig.camera.unit.limits["MinTilt"] == "-110"


async def test_a_preset_a_role_and_guesses_by_script(start, tmp_path):
    script = tmp_path / "faults.yaml"
    script.write_text("camera: {role: operator, profile: inverted}\nfaults: []\n")
    visitor = await start(faults=str(script), rate=5.0)
    await visitor.ptz(pan=20)
    await visitor.rest()
    visitor.rig.inject(Fault(kind=FaultKind.PRESET, name="Home"))
    await visitor.until(lambda: len(visitor.rig.camera.unit.orders) == 2)
    await visitor.rest()
    assert (await visitor.position())["pan"] == 0
    visitor.rig.inject(Fault(kind=FaultKind.ROLE, value="viewer"))
    while (await visitor.ptz(query="position")).status != 403:
        pass
    visitor.rig.inject(Fault(kind=FaultKind.ROLE, value="operator"))
    while (await visitor.ptz(query="position")).status != 200:
        pass
    visitor.rig.inject(Fault(kind=FaultKind.GUESSES))
    while (await visitor.get("/axis-cgi/param.cgi", action="list")).status != 403:
        pass


@pytest.mark.parametrize("text", [
    "camera: {profile: 7}", "camera: {colour: red}", "camera: {role: god}", "7",
    "- {kind: nonsense}", "- {kind: stall, forever: 1}", "x: [", "- {kind: stall, at_s: -1}",
    "- {kind: stall, device: microphone}",
])  # fmt: skip
async def test_a_wrong_script_is_refused_with_its_path(tmp_path, room, text):
    script = tmp_path / "faults.yaml"
    script.write_text(text)
    with pytest.raises(SimulationError, match=r"faults\.yaml"):
        await SimRig(SimSettings(faults=str(script)), scene=room).__aenter__()


@pytest.mark.parametrize(("fault", "culprit"), [
    (Fault(kind=FaultKind.KNOCK, device="fisheye"), "knock"),
    (Fault(kind=FaultKind.PARAMETER, name="PTZ.Nonsense"), "PTZ.Nonsense"),
    (Fault(kind=FaultKind.PRESET, name="Nowhere"), "Nowhere"),
    (Fault(kind=FaultKind.ROLE, value="god"), "viewer, operator, administrator"),
])  # fmt: skip
async def test_a_fault_that_a_device_cannot_have_is_refused(visitor, fault, culprit):
    with pytest.raises(SimulationError, match=culprit):
        visitor.rig.inject(fault)


@pytest.mark.parametrize("name", ["room", "pair_hall", "pair_room"])
def test_every_scene_has_a_calibration_and_boxes_in_reach(name):
    scene, kind = load_scene(name), PROFILES["v5915"]
    lens, head = fisheye_camera(scene.camera, None), head_model(kind.mount, kind)
    calibration = read_rig(calibration_text(SimSettings(), scene, lens, kind), "rig.yaml")
    assert calibration.metric is scene.file.head_from_fisheye.metric
    for box in scene.demo_boxes:
        found = direction(scene, lens, head, *box.centre_px)
        assert found is not None
        assert kind.tilt.low < found.vapix.tilt_deg < kind.tilt.high


async def test_serve_runs_until_it_is_cancelled(room, monkeypatch):
    monkeypatch.setattr("ptzd.sim.rig.load_scene", lambda _name: room)
    started: asyncio.Queue[SimRig] = asyncio.Queue()
    task = asyncio.create_task(serve(SimSettings(), started.put_nowait))
    rig = await started.get()
    async with aiohttp.ClientSession() as session:
        async with session.get(f"{rig.truth_url}/truth/boxes") as reply:
            assert len((await reply.json())["boxes"]) >= 3
        task.cancel()
        with pytest.raises(asyncio.CancelledError):
            await task
        with pytest.raises(aiohttp.ClientConnectionError):
            await session.get(f"{rig.truth_url}/truth/boxes")


async def test_an_unknown_profile_or_scene_is_named():
    with pytest.raises(SimulationError, match="v9999"):
        SimRig(SimSettings(profile="v9999"))
    with pytest.raises(SimulationError, match="nowhere"):
        await SimRig(SimSettings(scene="nowhere")).__aenter__()


def test_no_repr_shows_the_password():
    assert "pan-tilt-zoom" not in repr(SimSettings())
