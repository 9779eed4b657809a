"""Pictures over the socket: framing, moments, poses."""

import math
import re

import cv2
import numpy as np
import pytest

from ptzd.calibration.file import read_rig
from ptzd.model import HeadReading
from ptzd.sim.faults import Fault, FaultKind
from ptzd.sim.head import Pose
from ptzd.sim.imager import Exposure, PtzEye
from ptzd.sim.rig_truth import head_model

IMAGE = "/axis-cgi/jpg/image.cgi"
VIDEO = "/axis-cgi/mjpg/video.cgi"
SMALL = {"resolution": "320x240", "compression": 30}
PART = re.compile(rb"--myboundary\r\nContent-Type: image/jpeg\r\nContent-Length: (\d+)\r\n\r\n")


def decode(jpeg: bytes) -> np.ndarray | None:
    return cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_COLOR)


async def stream_bytes(visitor, **query: object) -> tuple[dict[str, str], bytes]:
    """Everything until the connection closes."""
    answer = await visitor.get(VIDEO, **{**SMALL, **query})
    return answer.headers, answer.body


def parts(body: bytes) -> list[bytes]:
    found, at = [], 0
    while match := PART.match(body, at):
        end = match.end() + int(match[1])
        found.append(body[match.end() : end])
        assert body[end : end + 2] == b"\r\n"
        at = end + 2
    assert at == len(body)
    return found


async def test_a_still_is_a_jpeg_of_the_size_asked_for(visitor):
    answer = await visitor.get(IMAGE, resolution="640x360")
    assert answer.headers["Content-Type"] == "image/jpeg"
    assert int(answer.headers["Content-Length"]) == len(answer.body)
    assert decode(answer.body).shape == (360, 640, 3)


@pytest.mark.parametrize("wrong", [{"resolution": "1x1"}, {"compression": "x"}, {"camera": 2}, {"rotation": 45}])
async def test_a_still_that_the_camera_cannot_take_is_refused(visitor, wrong):
    answer = await visitor.get(IMAGE, **{**SMALL, **wrong})
    assert answer.status == 400
    assert next(iter(wrong)) in answer.text


async def test_rotation_turns_the_picture(start):
    visitor = await start(ptz_noise_sigma=0.0)
    upright = decode((await visitor.get(IMAGE, **SMALL, rotation=0)).body)
    turned = decode((await visitor.get(IMAGE, **SMALL, rotation=90)).body)
    assert turned.shape == (320, 240, 3)
    difference = np.abs(np.rot90(upright, -1).astype(int) - turned.astype(int))
    assert difference.mean() < 4


async def test_compression_trades_bytes(visitor):
    sizes = [len((await visitor.get(IMAGE, resolution="320x240", compression=level)).body) for level in (0, 30, 90)]
    assert sizes[0] > sizes[1] > sizes[2]


async def test_a_stream_has_the_cameras_framing_and_just_ends(visitor):
    headers, body = await stream_bytes(visitor, fps=20, nbrofframes=4)
    assert headers["Content-Type"] == "multipart/x-mixed-replace; boundary=myboundary"
    assert "Transfer-Encoding" not in headers
    assert "Content-Length" not in headers
    pictures = parts(body)
    assert len(pictures) == 4
    assert len(set(pictures)) == 4
    assert all(decode(picture).shape == (240, 320, 3) for picture in pictures)


async def test_a_duration_ends_the_stream(visitor):
    _, body = await stream_bytes(visitor, fps=20, duration=1)
    assert 1 <= len(parts(body)) <= 22


async def test_the_old_boundary_header_has_the_dashes(visitor):
    visitor.rig.camera.unit.parameters["Image.RFCCompliantMultipartEnabled"] = "no"
    headers, body = await stream_bytes(visitor, fps=20, nbrofframes=1)
    assert headers["Content-Type"].endswith("boundary=--myboundary")
    assert len(parts(body)) == 1


async def test_pictures_arrive_after_the_latency_at_the_asked_rate(start):
    visitor = await start(image_latency_s=0.15)
    _, body = await stream_bytes(visitor, fps=10, nbrofframes=6)
    records = [await visitor.true_frame(picture) for picture in parts(body)]
    times = [record["t_ns"] / 1e9 for record in records]
    steps = np.diff(times)
    assert np.allclose(steps, np.round(steps * 10) / 10, atol=1e-3)
    assert visitor.rig.clock.now_s() - times[-1] >= 0.15


async def test_noise_differs_from_picture_to_picture_and_not_from_run_to_run(start):
    def pictures(visitor):
        return [visitor.get(IMAGE, **SMALL) for _ in range(3)]

    runs = []
    for _ in range(2):
        visitor = await start(ptz_noise_sigma=3.0)
        head, clock = visitor.rig.camera.unit.head, visitor.rig.clock
        await visitor.until(lambda head=head, clock=clock: head.since_zoom_s(clock.now_s()) > 0.6)
        runs.append([(await picture).body for picture in pictures(visitor)])
    assert len(set(runs[0])) == 3
    assert runs[0] == runs[1]


async def test_a_picture_shows_the_true_pose_of_its_exposure(start, room):
    """A point of the room lies where the truth of pose and lens projects it, to a fraction of a pixel."""
    visitor = await start(ptz_noise_sigma=0.0, ptz_size_px=(320, 240))
    rig = visitor.rig
    await visitor.ptz(pan=-10.3, tilt=4.2, zoom=300)
    await visitor.rest()
    answer = await visitor.get(IMAGE, resolution="320x240", compression=0)
    shown = cv2.cvtColor(decode(answer.body), cv2.COLOR_BGR2GRAY)
    pose = (await visitor.true_frame(answer.body))["pose"]
    assert pose["pan_deg"] == pytest.approx(-10.3, abs=0.01)
    drawn = expected_grey(rig, room, pose, (320, 240))
    (dx, dy), _ = cv2.phaseCorrelate(drawn.astype(np.float32), shown.astype(np.float32))
    assert math.hypot(dx, dy) < 0.05
    moved = expected_grey(rig, room, pose | {"pan_deg": pose["pan_deg"] + 0.5}, (320, 240))
    (dx, _), _ = cv2.phaseCorrelate(moved.astype(np.float32), shown.astype(np.float32))
    assert abs(dx) > 1.5


def expected_grey(rig, room, pose: dict[str, float], size_px: tuple[int, int]) -> np.ndarray:
    """The picture by the geometry room's own rig model, read from the calibration that is handed out."""
    truth = read_rig(rig.calibration_text(), "rig.yaml")
    reading = HeadReading(pan_deg=pose["pan_deg"], tilt_deg=pose["tilt_deg"], zoom=pose["zoom"])
    pixels = np.stack(np.meshgrid(np.arange(size_px[0]), np.arange(size_px[1])), axis=-1).astype(float)
    rays = truth.lift_from_view(pixels, reading)
    return cv2.cvtColor(room.sample_ptz(rays, 1 / truth.camera(reading).fx), cv2.COLOR_BGR2GRAY)


async def test_a_picture_taken_in_motion_shows_the_pose_between_start_and_end(visitor):
    await visitor.ptz(pan=80)
    seen = []
    while visitor.rig.camera.unit.head.busy(visitor.rig.clock.now_s()):
        record = await visitor.true_frame((await visitor.get(IMAGE, **SMALL)).body)
        truth = await visitor.truth("/truth/pose", t_ns=record["t_ns"])
        assert record["pose"]["pan_deg"] == pytest.approx(truth["pan_deg"], abs=0.01)
        seen.append(record["pose"]["pan_deg"])
    assert any(5 < pan < 75 for pan in seen)


async def test_a_frozen_picture_shows_the_start_until_arrival(start):
    visitor = await start()
    visitor.rig.camera.unit.parameters["PTZ.UserAdv.U1.ImageFreeze"] = "on"
    await visitor.ptz(pan=40)
    seen = []
    while visitor.rig.camera.unit.head.busy(visitor.rig.clock.now_s()):
        seen.append((await visitor.true_frame((await visitor.get(IMAGE, **SMALL)).body))["pose"]["pan_deg"])
    assert all(abs(pan) < 0.1 for pan in seen[:-1])
    await visitor.rest()
    last = await visitor.true_frame((await visitor.get(IMAGE, **SMALL)).body)
    assert last["pose"]["pan_deg"] == pytest.approx(40, abs=0.02)


def test_motion_smears_along_its_direction_and_zooming_defocuses(room, kind):
    eye = PtzEye(room, kind, head_model(kind.mount, kind), noise_sigma=0.0, seed=1)
    pose = Pose(pan_deg=0.0, tilt_deg=0.0, zoom=1.0)
    sharp = eye.clean(Exposure(pose=pose, size_px=(320, 240))).astype(float)
    smeared = eye.clean(Exposure(pose=pose, size_px=(320, 240), sweep_px=(12.0, 0.0))).astype(float)
    soft = eye.clean(Exposure(pose=pose, size_px=(320, 240), defocus_px=2.0)).astype(float)

    def edges(picture: np.ndarray, axis: int) -> float:
        return float(np.abs(np.diff(picture, axis=axis)).mean())

    assert edges(smeared, 1) < 0.6 * edges(sharp, 1)
    assert edges(smeared, 0) > 0.6 * edges(sharp, 0)
    assert edges(soft, 0) < 0.8 * edges(sharp, 0)


@pytest.mark.parametrize(("kind_of", "whole"), [
    (FaultKind.TRUNCATE, False), (FaultKind.CORRUPT, True),
])  # fmt: skip
async def test_spoilt_pictures_keep_the_framing(visitor, kind_of, whole):
    visitor.rig.inject(Fault(kind=kind_of, path="*video.cgi*", count=1))
    _, body = await stream_bytes(visitor, fps=20, nbrofframes=3)
    first, *others = parts(body)
    assert first.endswith(b"\xff\xd9") is whole
    assert all(picture.endswith(b"\xff\xd9") for picture in others)


async def test_a_short_part_announces_more_than_it_sends(visitor):
    visitor.rig.inject(Fault(kind=FaultKind.SHORT, count=1))
    _, body = await stream_bytes(visitor, fps=20, nbrofframes=3)
    first, second = PART.match(body), PART.search(body, 10)
    assert second.start() < first.end() + int(first[1])
    assert len(parts(body[second.start() :])) == 2


async def test_a_spoilt_still_is_shorter_than_it_should_be(visitor):
    visitor.rig.inject(Fault(kind=FaultKind.TRUNCATE, path="*image.cgi*", count=1))
    first, second = [(await visitor.get(IMAGE, **SMALL)).body for _ in range(2)]
    assert len(first) < 0.7 * len(second)
    assert not first.endswith(b"\xff\xd9")


async def test_a_cut_ends_the_stream_inside_a_picture(visitor):
    visitor.rig.inject(Fault(kind=FaultKind.CUT, count=1))
    _, body = await stream_bytes(visitor, fps=20, nbrofframes=10)
    match = PART.match(body)
    assert match is None or len(body) < match.end() + int(match[1])


async def test_a_stall_sends_nothing_for_its_time(visitor):
    visitor.rig.inject(Fault(kind=FaultKind.STALL, for_s=0.5, count=1))
    before = visitor.rig.clock.now_s()
    _, body = await stream_bytes(visitor, fps=20, nbrofframes=2)
    assert len(parts(body)) == 1
    assert visitor.rig.clock.now_s() - before >= 0.5


async def test_too_many_viewers_or_configurations_get_503(start):
    visitor = await start(max_viewers=2, max_configurations=1)
    url = visitor.rig.camera_url + VIDEO
    async with visitor.session.get(url, params={**SMALL, "fps": 5}) as first:
        await first.content.readany()
        other = await visitor.get(VIDEO, resolution="640x480", fps=5)
        assert other.status == 503
        async with visitor.session.get(url, params={**SMALL, "fps": 5}) as second:
            assert second.status == 200
            assert (await visitor.get(VIDEO, **SMALL, fps=5)).status == 503
    await visitor.until(lambda: visitor.rig.camera.viewers == 0)
    assert (await visitor.get(VIDEO, **SMALL, fps=6, nbrofframes=1)).status == 200


async def test_e_flip_turns_the_picture_past_the_nadir(start, room):
    visitor = await start(profile="dome", e_flip_tilt_deg=-110.0, ptz_noise_sigma=0.0)
    await visitor.ptz(tilt=-89)
    await visitor.rest()
    before = decode((await visitor.get(IMAGE, **SMALL)).body)
    await visitor.ptz(tilt=-91)
    await visitor.rest()
    after = decode((await visitor.get(IMAGE, **SMALL)).body)
    turned = np.rot90(after, 2)
    shift = [cv2.phaseCorrelate(*(cv2.cvtColor(p, cv2.COLOR_BGR2GRAY).astype(np.float32) for p in (before, other)))[1]
             for other in (turned, after)]  # fmt: skip
    assert shift[0] > shift[1]


async def test_image_size(visitor):
    assert (await visitor.get("/axis-cgi/imagesize.cgi", resolution="640x480")).text == (
        "image width = 640\nimage height = 480\n"
    )
