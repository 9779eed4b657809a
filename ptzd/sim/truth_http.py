"""The side channel: what is true of the rig, over HTTP on a port of its own. Never part of what a camera answers.

====================  =============================================================================================
``/truth/pose``       true, encoder and reported pose now (``?t_ns=`` for a moment of the last two minutes); when the
                      optics come to rest by what is ordered so far, swing included (null while that is unknown)
``/truth/direction``  ``?x=&y=``: where the head has to look for a fisheye pixel
``/truth/frame``      ``?sha256=``: exposure time and true pose of a PTZ picture with these bytes
``/truth/frames``     the latest PTZ pictures
``/truth/orders``     the latest orders that the head took up, and who gave them
``/truth/boxes``      the scene's boxes for demonstrations
``/truth/calibration`` rig.yaml
``/truth/fault``      POST a fault (fields of :class:`ptzd.sim.faults.Fault`); DELETE ends all
====================  =============================================================================================

Times are ns since the epoch on the simulator's clock; ``monotonic_ns`` is the machine's monotonic clock then.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from types import TracebackType

import msgspec
from aiohttp import web

from ptzd.errors import SimulationError
from ptzd.sim.auth import Role
from ptzd.sim.camera import AxisCamera
from ptzd.sim.faults import FISHEYE_KINDS, Fault, FaultKind
from ptzd.sim.fisheye import FisheyeCamera
from ptzd.sim.head import Pose
from ptzd.sim.optics import hfov_deg
from ptzd.sim.rig_truth import Direction
from ptzd.sim.scene import Scene
from ptzd.sim.stream import ShotRecord
from ptzd.sim.wire import Listener

Document = dict[str, object]


class TruthServer:
    """Serves the table above.

    Parameters
    ----------
    camera : AxisCamera
    fisheye : FisheyeCamera
    scene : Scene
    direction : Callable
        Truth of a fisheye pixel.
    calibration : str
        Text of rig.yaml.
    host, port
        Where to listen; port 0: any free one.
    """

    def __init__(
        self,
        camera: AxisCamera,
        fisheye: FisheyeCamera,
        scene: Scene,
        *,
        direction: Callable[[float, float], Direction | None],
        calibration: str,
        host: str,
        port: int,
    ) -> None:
        self._camera = camera
        self._fisheye = fisheye
        self._scene = scene
        self._direction = direction
        self._calibration = calibration
        self._host = host
        self.port = port
        self._listener: Listener | None = None
        app = web.Application()
        app.router.add_get("/truth/pose", self._pose)
        app.router.add_get("/truth/direction", self._bearing)
        app.router.add_get("/truth/frame", self._frame)
        app.router.add_get("/truth/frames", self._frames)
        app.router.add_get("/truth/orders", self._orders)
        app.router.add_get("/truth/boxes", self._boxes)
        app.router.add_get("/truth/calibration", self._rig_yaml)
        app.router.add_post("/truth/fault", self._fault)
        app.router.add_delete("/truth/fault", self._no_fault)
        self._runner = web.AppRunner(app, shutdown_timeout=0.1, access_log=None)

    async def __aenter__(self) -> TruthServer:
        await self._runner.setup()
        try:
            self._listener = Listener(self._runner, self._host, self.port)
            await self._listener.open()
        except BaseException:
            await self._runner.cleanup()
            raise
        self.port = self._listener.port
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._listener is not None:
            await self._listener.shut()
            self._listener.close()
        await self._runner.cleanup()

    def pose_document(self, t_s: float) -> Document:
        """True, encoder and reported pose at a moment."""
        unit = self._camera.unit
        optical, rest_s = unit.head.optical(t_s), unit.head.rest_s(t_s)
        return {
            "t_ns": int(t_s * 1e9),
            "monotonic_ns": time.monotonic_ns() + int((t_s - unit.clock.now_s()) * 1e9),
            **_pose(optical),
            "hfov_deg": hfov_deg(unit.profile, optical.zoom, unit.settings.ptz_size_px),
            "moving": unit.head.moving(t_s),
            "busy": unit.head.busy(t_s),
            "rest_ns": int(rest_s * 1e9) if math.isfinite(rest_s) else None,
            "encoder": _pose(unit.head.encoder(t_s)),
            "reported": _pose(unit.head.reported(t_s)),
        }

    async def _pose(self, request: web.Request) -> web.Response:
        now_s = self._camera.unit.clock.now_s()
        t_s = min(int(request.query["t_ns"]) / 1e9, now_s) if "t_ns" in request.query else now_s
        return _json(self.pose_document(t_s))

    async def _bearing(self, request: web.Request) -> web.Response:
        try:
            found = self._direction(float(request.query["x"]), float(request.query["y"]))
        except (KeyError, ValueError):
            return _json({"error": "give x and y in px"}, status=400)
        except SimulationError as error:
            return _json({"error": str(error)}, status=404)
        if found is None:
            return _json({"error": "outside the image circle"}, status=404)
        return _json(msgspec.to_builtins(found))

    async def _frame(self, request: web.Request) -> web.Response:
        record = self._camera.shots.find(request.query.get("sha256", ""))
        return _json(_shot(record)) if record else _json({"error": "no such picture"}, status=404)

    async def _frames(self, request: web.Request) -> web.Response:
        count = int(request.query.get("count", "100"))
        return _json({"frames": [_shot(record) for record in self._camera.shots.latest(count)]})

    async def _orders(self, _request: web.Request) -> web.Response:
        orders = [
            {
                "t_ns": int(record.t_s * 1e9),
                "start_ns": int(record.start_s * 1e9),
                "source": record.source,
                "kind": type(record.order).__name__,
                **msgspec.to_builtins(record.order),
            }
            for record in self._camera.unit.orders
        ]
        return _json({"orders": orders})

    async def _boxes(self, _request: web.Request) -> web.Response:
        boxes = [{"name": box.name, "x": box.x, "y": box.y, "w": box.w, "h": box.h} for box in self._scene.demo_boxes]
        return _json({"boxes": boxes})

    async def _rig_yaml(self, _request: web.Request) -> web.Response:
        return web.Response(text=self._calibration, content_type="application/yaml")

    async def _fault(self, request: web.Request) -> web.Response:
        try:
            fault = msgspec.json.decode(await request.read(), type=Fault)
            arm(fault, self._camera, self._fisheye)
        except (msgspec.ValidationError, msgspec.DecodeError, SimulationError) as error:
            return _json({"error": str(error)}, status=400)
        return _json({"armed": fault.kind.value})

    async def _no_fault(self, _request: web.Request) -> web.Response:
        self._camera.faults.clear()
        self._fisheye.faults.clear()
        return _json({})


ROLES = tuple(role.name.lower() for role in Role)


def arm(fault: Fault, camera: AxisCamera, fisheye: FisheyeCamera) -> None:
    """Give a fault to its device.

    Raises
    ------
    SimulationError
        When that device cannot have it, or the parameter, preset or role that it names does not exist.
    """
    if fault.device == "fisheye" and fault.kind not in FISHEYE_KINDS:
        raise SimulationError(f"kind: a fisheye cannot have {fault.kind.value!r}; it can have {_names(FISHEYE_KINDS)}")
    if fault.kind is FaultKind.PARAMETER and fault.name not in camera.unit.parameters:
        raise SimulationError(f"name: the camera has no parameter {fault.name!r}; param.cgi lists them")
    if fault.kind is FaultKind.PRESET and camera.unit.preset_number(fault.name) is None:
        raise SimulationError(f"name: the camera has no preset {fault.name!r}")
    if fault.kind is FaultKind.ROLE and fault.value not in ROLES:
        raise SimulationError(f"value: {fault.value!r} is no role; there are {', '.join(ROLES)}")
    box = fisheye.faults if fault.device == "fisheye" else camera.faults
    box.add(fault, camera.unit.clock.now_s())


def _names(kinds: frozenset[FaultKind]) -> str:
    return ", ".join(sorted(kind.value for kind in kinds))


def _pose(pose: Pose) -> Document:
    return {"pan_deg": pose.pan_deg, "tilt_deg": pose.tilt_deg, "zoom": pose.zoom}


def _shot(record: ShotRecord) -> Document:
    pose = _pose(record.pose) if record.pose else None
    return {"sha256": record.sha256, "t_ns": int(record.t_s * 1e9), "pose": pose}


def _json(document: object, *, status: int = 200) -> web.Response:
    return web.Response(body=msgspec.json.encode(document), status=status, content_type="application/json")
