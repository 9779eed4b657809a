"""The whole rig without hardware: AXIS camera, fisheye and side channel on free loopback ports."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from contextlib import AsyncExitStack
from functools import partial
from types import TracebackType

from ptzd.geometry.unified import UnifiedCamera
from ptzd.sim.camera import AxisCamera
from ptzd.sim.clock import SimClock, WallClock
from ptzd.sim.faults import Fault
from ptzd.sim.fisheye import FisheyeCamera
from ptzd.sim.imager import fisheye_picture
from ptzd.sim.profile import profile
from ptzd.sim.rig_truth import Direction, calibration_text, direction, fisheye_camera, head_model
from ptzd.sim.scene import Scene, load_scene
from ptzd.sim.script import Script, read_script
from ptzd.sim.settings import SimSettings
from ptzd.sim.truth_http import TruthServer, arm


class SimRig:
    """``async with SimRig(settings) as rig`` loads the scene and starts everything; leaving stops everything.

    Parameters
    ----------
    settings : SimSettings
    scene : Scene, optional
        Loaded already; without it ``settings.scene`` is loaded.
    clock : SimClock, optional
        The wall clock by default.

    Attributes
    ----------
    camera : AxisCamera
        ``camera.url``, ``camera.inject(fault)``, ``camera.reboot()``, ``camera.unit`` (parameters, head).
    fisheye : FisheyeCamera
        ``fisheye.url``, ``fisheye.unplug()``, ``fisheye.plug_in()``.

    Raises
    ------
    SimulationError
        When started: unknown scene or profile, wrong fault script, port in use.
    """

    scene: Scene
    camera: AxisCamera
    fisheye: FisheyeCamera
    truth: TruthServer
    fisheye_camera: UnifiedCamera
    """The lens."""

    def __init__(self, settings: SimSettings, *, scene: Scene | None = None, clock: SimClock | None = None) -> None:
        self.settings = settings
        self.clock = clock or WallClock()
        self._shape()
        self._loaded = scene
        self._stack = AsyncExitStack()

    def _shape(self) -> None:
        self.profile = profile(self.settings.profile)
        self.head = head_model(self.settings.mount or self.profile.mount, self.profile)

    async def __aenter__(self) -> SimRig:
        run = asyncio.get_running_loop().run_in_executor
        script = await run(None, read_script, self.settings.faults) if self.settings.faults else Script()
        self.settings = settings = script.applied(self.settings)
        self._shape()
        self.scene = await run(None, load_scene, settings.scene) if self._loaded is None else self._loaded
        self.fisheye_camera = fisheye_camera(self.scene.camera, settings.fisheye_size_px)
        draw = partial(fisheye_picture, self.scene, self.fisheye_camera)
        async with AsyncExitStack() as stack:
            camera = AxisCamera(settings, self.scene, self.head, self.clock)
            self.camera = await stack.enter_async_context(camera)
            fisheye = FisheyeCamera(settings, draw, self.fisheye_camera, self.clock)
            self.fisheye = await stack.enter_async_context(fisheye)
            self.truth = await stack.enter_async_context(self._truth_server())
            for fault in script.faults:
                self.inject(fault)
            self._stack = stack.pop_all()
        return self

    def _truth_server(self) -> TruthServer:
        return TruthServer(
            self.camera,
            self.fisheye,
            self.scene,
            direction=self.direction,
            calibration=self.calibration_text(),
            host=self.settings.host,
            port=self.settings.truth_port,
        )

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await self._stack.aclose()

    @property
    def camera_url(self) -> str:
        """Base address of the AXIS camera, HTTP."""
        return self.camera.url

    @property
    def fisheye_url(self) -> str:
        """Address of the fisheye's MJPEG stream."""
        return self.fisheye.url

    @property
    def truth_url(self) -> str:
        """Base address of the side channel."""
        return f"http://{self.settings.host}:{self.truth.port}"

    def direction(self, x: float, y: float) -> Direction | None:
        """Truth of one fisheye pixel, px; None outside the image circle."""
        return direction(self.scene, self.fisheye_camera, self.head, x, y)

    def calibration_text(self) -> str:
        """rig.yaml of this rig, with the errors that the settings ask for."""
        return calibration_text(self.settings, self.scene, self.fisheye_camera, self.profile)

    def inject(self, fault: Fault) -> None:
        """Arm a fault on the device that it names; its time counts from now."""
        arm(fault, self.camera, self.fisheye)


async def serve(settings: SimSettings, ready: Callable[[SimRig], None]) -> None:
    """Run a rig until cancelled; ``ready`` is called once it answers."""
    async with SimRig(settings) as rig:
        ready(rig)
        await asyncio.Event().wait()
