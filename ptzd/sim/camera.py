"""One simulated AXIS camera: its parts, its ports, its own programs, its restarts."""

from __future__ import annotations

import asyncio
import hashlib
import ssl
from collections.abc import Coroutine
from types import TracebackType

from ptzd.geometry.head import HeadModel
from ptzd.sim.auth import Gate, User
from ptzd.sim.camera_http import CameraServer
from ptzd.sim.certificate import Certificate, self_signed
from ptzd.sim.clock import SimClock
from ptzd.sim.faults import Fault, FaultBox
from ptzd.sim.imager import PtzEye
from ptzd.sim.picture_cgi import PictureCgi
from ptzd.sim.programs import Programs
from ptzd.sim.scene import Scene
from ptzd.sim.settings import SimSettings
from ptzd.sim.stream import Darkroom, ShotLog
from ptzd.sim.unit import Unit
from ptzd.sim.wire import Network


class AxisCamera:
    """A camera on HTTP and, if asked for, HTTPS.

    Parameters
    ----------
    settings : SimSettings
    scene : Scene
    head : HeadModel
        The true mount.
    clock : SimClock
    """

    def __init__(self, settings: SimSettings, scene: Scene, head: HeadModel, clock: SimClock) -> None:
        self.settings = settings
        self.unit = Unit(settings, clock)
        self.faults = FaultBox()
        self.shots = ShotLog()
        self.port = 0
        self.https_port = 0
        self.certificate: Certificate | None = None
        profile = self.unit.profile
        own = User(name=settings.user, password=settings.password, role=settings.role, ptz=settings.ptz_right)
        self.gate = Gate(
            (own, *settings.extra_users),
            realm=f"AXIS_{profile.serial}",
            policy=settings.policy,
            nonce_life_s=settings.nonce_life_s,
            basic_first=settings.basic_first,
            old_style=profile.old_style_digest,
            secret=hashlib.sha256(f"nonce {settings.seed}".encode()).digest(),
        )
        eye = PtzEye(scene, profile, head, noise_sigma=settings.ptz_noise_sigma, seed=settings.seed)
        self._darkroom = Darkroom()
        self._pictures = PictureCgi(self.unit, eye, self._darkroom, self.faults, self.shots)
        self._server = CameraServer(self.unit, self.gate, self._pictures, self.faults, self.reboot)
        self.asked = self._server.asked
        self.network = Network(self._server.app(), settings.host, clock)
        self._tasks: set[asyncio.Task[None]] = set()

    async def __aenter__(self) -> AxisCamera:
        ports: list[tuple[int, ssl.SSLContext | None]] = [(self.settings.ptz_port, None)]
        if self.settings.https:
            self.certificate = self_signed(f"axis-{self.unit.profile.serial.lower()}")
            ports.append((0, self.certificate.server_context()))
        self.port, *secure = await self.network.open(*ports)
        self.https_port = secure[0] if secure else 0
        programs = Programs(self.unit, self.gate, self.faults, self.network, self.reboot)
        self._spawn(programs.run(), "sim camera programs")
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)
        await self.network.close()
        self._darkroom.close()

    def _spawn(self, work: Coroutine[None, None, None], name: str) -> None:
        task = asyncio.create_task(work, name=name)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    @property
    def viewers(self) -> int:
        """Open streams."""
        return self._pictures.viewers

    @property
    def url(self) -> str:
        """Where it answers over HTTP."""
        return f"http://{self.settings.host}:{self.port}"

    @property
    def https_url(self) -> str:
        """Where it answers over HTTPS."""
        return f"https://{self.settings.host}:{self.https_port}"

    def inject(self, fault: Fault) -> None:
        """Arm a fault; its time counts from now."""
        self.faults.add(fault, self.unit.clock.now_s())

    def reboot(self) -> None:
        """Restart as after a loss of power: gone, then 503, then ready at home."""
        self._spawn(self._reboot(), "sim reboot")

    async def _reboot(self) -> None:
        clock, boot_s = self.unit.clock, self.settings.boot_s
        self._server.ready = False
        await self.network.be_away(boot_s)
        self.gate.forget_nonces()
        self.unit.head.find_zero(clock.now_s())
        self.unit.go_home("start-up")
        await clock.sleep_until(clock.now_s() + boot_s / 2)
        self._server.restarted()
