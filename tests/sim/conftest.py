import asyncio
import hashlib
import threading
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import AsyncExitStack
from dataclasses import dataclass

import aiohttp
import pytest

from ptzd.sim.clock import SimClock, VirtualClock, WallClock
from ptzd.sim.profile import profile
from ptzd.sim.rig import SimRig
from ptzd.sim.scene import Scene, load_scene
from ptzd.sim.settings import SimSettings
from ptzd.sim.unit import Unit

PTZ = "/axis-cgi/com/ptz.cgi"


@dataclass(frozen=True)
class Answer:
    status: int
    text: str
    headers: dict[str, str]
    body: bytes

    @property
    def values(self) -> dict[str, str]:
        """``key=value`` lines."""
        return dict(line.split("=", 1) for line in self.text.splitlines() if "=" in line)


class Visitor:
    """A plain aiohttp client of a rig: digest, one session."""

    def __init__(self, rig: SimRig, session: aiohttp.ClientSession, side: aiohttp.ClientSession) -> None:
        self.rig = rig
        self.session = session
        self.side = side
        """For the side channel and the fisheye: no credentials."""

    async def get(self, path: str, **query: object) -> Answer:
        url = path if path.startswith("http") else self.rig.camera_url + path
        session = self.session if url.startswith(self.rig.camera_url) else self.side
        async with session.get(url, params={name: str(value) for name, value in query.items()}) as response:
            body = await response.read()
            return Answer(response.status, body.decode("utf-8", "replace"), dict(response.headers), body)

    async def ptz(self, **query: object) -> Answer:
        return await self.get(PTZ, **query)

    async def position(self) -> dict[str, float]:
        values = (await self.ptz(query="position")).values
        return {key: float(values[key]) for key in ("pan", "tilt", "zoom")}

    async def truth(self, path: str, **query: object) -> dict[str, object]:
        async with self.side.get(self.rig.truth_url + path, params={k: str(v) for k, v in query.items()}) as reply:
            return await reply.json()

    async def until(self, condition: Callable[[], bool]) -> None:
        """Wait for something that is seen by looking only."""
        while not condition():  # noqa: ASYNC110
            await asyncio.sleep(0.01)

    async def rest(self) -> None:
        """Wait until nothing moves and nothing is waiting, by the truth."""
        head, clock = self.rig.camera.unit.head, self.rig.clock
        await self.until(lambda: not head.busy(clock.now_s()))
        await clock.sleep_until(head.rest_s(clock.now_s()) + 0.3)

    async def true_frame(self, jpeg: bytes) -> dict[str, object]:
        return await self.truth("/truth/frame", sha256=hashlib.sha256(jpeg).hexdigest())


Start = Callable[..., Awaitable[Visitor]]


@pytest.fixture(scope="session")
def room() -> Scene:
    return load_scene("room")


@pytest.fixture
async def start(room: Scene) -> AsyncIterator[Start]:
    """Starts rigs with a client each; afterwards nothing may be left of them."""
    before = asyncio.all_tasks()
    async with AsyncExitStack() as stack:

        async def begin(*, rate: float = 1.0, clock: SimClock | None = None, **changes: object) -> Visitor:
            settings = SimSettings(**{"profile": "v5915", "fisheye_size_px": (320, 240), **changes})
            rig = await stack.enter_async_context(SimRig(settings, scene=room, clock=clock or WallClock(rate)))
            login = aiohttp.DigestAuthMiddleware(settings.user, settings.password)
            connector = aiohttp.TCPConnector(ssl=False)
            session = aiohttp.ClientSession(
                middlewares=(login,), connector=connector, cookie_jar=aiohttp.CookieJar(unsafe=True)
            )
            await stack.enter_async_context(session)
            return Visitor(rig, session, await stack.enter_async_context(aiohttp.ClientSession()))

        yield begin
    await asyncio.sleep(0.05)
    assert not [task for task in asyncio.all_tasks() - before if task is not asyncio.current_task()]
    assert not [thread for thread in threading.enumerate() if thread.name.startswith("sim-")]


@pytest.fixture
async def visitor(start: Start) -> Visitor:
    return await start()


@pytest.fixture
def clock() -> VirtualClock:
    return VirtualClock()


@pytest.fixture
def unit(clock: VirtualClock) -> Unit:
    return Unit(SimSettings(profile="v5915"), clock)


@pytest.fixture(params=["v5915", "dome", "old214", "inverted"])
def kind(request: pytest.FixtureRequest):
    return profile(request.param)
