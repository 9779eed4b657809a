"""A simulated rig over real sockets, the real daemon on it, and a client that hears everything."""

from __future__ import annotations

import asyncio
import contextlib
import os
import sys
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import AsyncExitStack
from pathlib import Path

import pytest
import yaml

from ptzd.app.daemon import serve
from ptzd.app.loading import load
from ptzd.app.replaying import replay
from ptzd.app.simulate import DEFAULT_PASSWORD, RIG, write_config
from ptzd.bus.client import Client, Notice
from ptzd.bus.messages import Accepted, Feedback, RoiResult, Status
from ptzd.sim.imager import Pixels, fisheye_picture
from ptzd.sim.rig import SimRig
from ptzd.sim.rig_truth import fisheye_camera
from ptzd.sim.scene import Scene, load_scene
from ptzd.sim.settings import SimSettings

PATIENCE_S = 100.0
"""For anything that must happen; a loaded machine is slow, a hang is a failure."""
ANSWER_S = 10.0
"""For the answer to a query, and for the silence after one that gets none."""


class Site:
    """One rig with its daemon. Leaving it checks what every end must leave behind."""

    def __init__(self, rig: SimRig, folder: Path, endpoint: str) -> None:
        self.rig = rig
        self.folder = folder
        self.endpoint = endpoint
        self.config = write_config(rig, folder, bus=endpoint, password=DEFAULT_PASSWORD)
        self.heard: list[Notice] = []
        self.asked: list[str] = []
        self.outcomes: dict[str, str] = {}
        self.stop = asyncio.Event()
        self.ready = asyncio.Event()
        self.serving: asyncio.Task[None] | None = None
        self.process: asyncio.subprocess.Process | None = None
        self.client: Client
        self._listening: asyncio.Task[None] | None = None
        self._news = asyncio.Condition()
        self._stack = AsyncExitStack()

    def change(self, **parts: dict[str, object]) -> None:
        """Put other values into the settings, part by part."""
        document = yaml.safe_load(self.config.read_text())
        for name, values in parts.items():
            document[name] = {**document.get(name, {}), **values}
        self.config.write_text(yaml.safe_dump(document))

    async def start(self, *, wait_ready: bool = True) -> None:
        """The daemon in this process, on this loop."""
        loaded = load(self.config)
        self.serving = asyncio.create_task(serve(loaded, self.stop, ready=self.ready.set), name="daemon")
        await self._listen()
        if wait_ready:
            await self.until(self.ready.is_set)

    async def spawn(
        self, *arguments: str, state: str = "IDLE", stdin: int = asyncio.subprocess.DEVNULL
    ) -> asyncio.subprocess.Process:
        """The daemon as a process of its own."""
        environ = {**os.environ, "PYTHONUNBUFFERED": "1"}
        self.process = await asyncio.create_subprocess_exec(
            sys.executable, "-m", "ptzd", "run", "--config", str(self.config), *arguments,
            stdin=stdin, stdout=asyncio.subprocess.PIPE, stderr=asyncio.subprocess.PIPE, env=environ,
        )  # fmt: skip
        await self._listen()
        await self.until_state(state)
        return self.process

    async def _listen(self) -> None:
        """Connect as soon as the bus is open; anything the rig says from then on is heard."""
        async with asyncio.timeout(PATIENCE_S):
            while True:
                client = Client.open(self.endpoint, rig=RIG, timeout_s=ANSWER_S)
                try:
                    self.client = await self._stack.enter_async_context(client)
                    await self.client.status()
                    break
                except Exception:  # noqa: BLE001 - nobody listens there yet
                    self._check_alive()
                    await asyncio.sleep(0.05)
        started = asyncio.Event()
        self._listening = asyncio.create_task(self._hear(started), name="listener")
        await self.until(lambda: bool(self.heard))

    def _check_alive(self) -> None:
        if self.serving is not None and self.serving.done():
            self.serving.result()
        if self.process is not None:
            assert self.process.returncode is None, "the daemon ended before it was up"

    async def _hear(self, started: asyncio.Event) -> None:
        started.set()
        async for notice in self.client.watch():
            self.heard.append(notice)
            async with self._news:
                self._news.notify_all()

    async def until(self, condition: Callable[[], bool], patience_s: float = PATIENCE_S) -> None:
        """Wait until something is true that is told by the rig (it speaks at least every second)."""
        async with asyncio.timeout(patience_s), self._news:
            await self._news.wait_for(condition)

    async def until_state(self, state: str, patience_s: float = PATIENCE_S) -> None:
        """Until the rig is in a state, or was in it since this was asked."""
        told = len(self.statuses)
        await self.until(lambda: state in {self.state, *(item.state for item in self.statuses[told:])}, patience_s)

    async def until_truth(self, condition: Callable[[], bool]) -> None:
        """Wait until something is true in the simulator, which tells nobody."""
        async with asyncio.timeout(PATIENCE_S):
            while not condition():  # noqa: ASYNC110
                await asyncio.sleep(0.01)

    @property
    def statuses(self) -> list[Status]:
        return [notice for notice in self.heard if isinstance(notice, Status)]

    @property
    def status(self) -> Status:
        """As told last."""
        return next(reversed(self.statuses), Status(t_ns=0, state=""))

    @property
    def state(self) -> str:
        """As told last."""
        return self.status.state

    @property
    def results(self) -> list[RoiResult]:
        return [notice for notice in self.heard if isinstance(notice, RoiResult)]

    def result_of(self, name: str) -> RoiResult | None:
        return next((result for result in self.results if result.id == name), None)

    def steps(self, name: str) -> list[Feedback]:
        return [notice for notice in self.heard if isinstance(notice, Feedback) and notice.id == name]

    @property
    def box(self) -> tuple[float, float, float, float]:
        """A box that the demo locks."""
        box = self.rig.scene.demo_boxes[0]
        return (box.x, box.y, box.w, box.h)

    @property
    def moving(self) -> bool:
        """By the truth."""
        return self.rig.camera.unit.head.moving(self.rig.clock.now_s())

    @property
    def orders(self) -> int:
        """Orders that the head took up so far."""
        return len(self.rig.camera.unit.orders)

    async def request(self, name: str, **fields: object) -> Accepted:
        self.asked.append(name)
        return await self.client.request(**{"id": name, "box": self.box, "hold_s": 0.0, **fields})

    async def end_of(self, name: str) -> RoiResult:
        await self.until(lambda: self.result_of(name) is not None)
        result = self.result_of(name)
        assert result is not None
        return result

    async def lock(self, name: str, **fields: object) -> RoiResult:
        """A request that must succeed: the proof that everything works (again)."""
        await self.request(name, **fields)
        result = await self.end_of(name)
        assert result.outcome == "locked", result
        return result

    async def until_locked(self, name: str) -> None:
        """Until it holds the target."""
        await self.until(lambda: any(step.step == "locked" for step in self.steps(name)))

    async def end(self) -> None:
        """Stop the daemon as SIGTERM does and check what it left behind."""
        if self.serving is not None:
            self.stop.set()
            async with asyncio.timeout(PATIENCE_S):
                await self.serving
        if self.process is not None and self.process.returncode is None:
            self.process.terminate()
            async with asyncio.timeout(PATIENCE_S):
                await self.process.communicate()
        await self._close()
        self.check_results()
        await self.check_head()
        self.check_log()

    async def abandon(self) -> None:
        """After a failure: end everything, check nothing."""
        if self.serving is not None:
            self.serving.cancel()
            await asyncio.gather(self.serving, return_exceptions=True)
        if self.process is not None and self.process.returncode is None:
            self.process.kill()
            await self.process.communicate()
        await self._close()

    async def _close(self) -> None:
        if self._listening is not None:
            with contextlib.suppress(TimeoutError):
                await self.until(lambda: {result.id for result in self.results} >= set(self.asked), 5.0)
            self._listening.cancel()
            await asyncio.gather(self._listening, return_exceptions=True)
        await self._stack.aclose()

    def check_results(self) -> None:
        """A subscriber that was there saw exactly one result of every request."""
        told = [result.id for result in self.results]
        assert {name: told.count(name) for name in self.asked} == dict.fromkeys(self.asked, 1)

    async def check_head(self) -> None:
        """The head comes to rest by itself: nobody has told it to go on."""
        orders = self.orders
        await self.until_truth(lambda: not self.rig.camera.unit.head.busy(self.rig.clock.now_s()))
        assert self.orders == orders

    def check_log(self) -> None:
        """Closed, readable, and the core decides the same again."""
        log = self.folder / "log"
        assert not list(log.glob("*.active"))
        files = sorted(log.glob("*.mcap"))
        assert files
        found = [replay(path) for path in files]
        assert [str(difference) for report in found for difference in report.differences] == []
        recorded = {name: result.outcome for report in found for name, result in report.recorded.items()}
        assert {name: recorded[name] for name in self.asked} == {
            r.id: r.outcome for r in self.results if r.id in self.asked
        }


@pytest.fixture(scope="session")
def hall() -> Scene:
    return load_scene("pair_hall")


@pytest.fixture(scope="session")
def fisheye_pixels(hall: Scene) -> Pixels:
    """The scene as the fisheye draws it: the same for every rig of the session."""
    return fisheye_picture(hall, fisheye_camera(hall.camera, None))


@pytest.fixture
async def make_site(
    hall: Scene, fisheye_pixels: Pixels, tmp_path: Path, new_port: Callable[[], int]
) -> AsyncIterator[Callable[..., Awaitable[Site]]]:
    """Makes rigs with settings for their daemon, which is started by the test; ends and checks them afterwards."""
    sites: list[Site] = []
    async with AsyncExitStack() as stack:

        async def make(**settings: object) -> Site:
            rig = await stack.enter_async_context(SimRig(SimSettings(**settings), scene=hall))
            rig.fisheye._picture = fisheye_pixels
            site = Site(rig, tmp_path / f"rig{len(sites)}", f"tcp/127.0.0.1:{new_port()}")
            site.change(home={"idle_s": 0.5}, fisheye={"stall_s": 10.0}, ptz={"stall_s": 20.0, "move_timeout_s": 60.0})
            sites.append(site)
            return site

        try:
            yield make
        except BaseException:
            for site in sites:
                await site.abandon()
            raise
        for site in sites:
            try:
                await site.end()
            finally:
                await site.abandon()


@pytest.fixture
async def site(make_site: Callable[..., Awaitable[Site]]) -> Site:
    """A rig whose daemon serves requests."""
    made = await make_site()
    await made.start()
    return made
