"""Random moves on every kind of simulated camera over sockets: limits, arrival against the truth, final pose.

python -m tests.bench.moves [--moves 1000] [--profile P] [--seed 1]

True rest is when all motors stand and the optics stay within one encoder step of where they end. Client and simulator
live on one virtual clock, so the figures hold whatever the machine is busy with. Exit status 1 when a law is broken.
"""

from __future__ import annotations

import argparse
import asyncio
import math
import random
import sys
import tempfile
from dataclasses import dataclass

import numpy as np

from ptzd.config import Limits, Ptz
from ptzd.devices.vapix.head import VapixHead
from ptzd.model import HeadLimits, HeadReading
from ptzd.ports import MoveStalled
from ptzd.sim.camera import AxisCamera
from ptzd.sim.faults import Fault, FaultKind
from ptzd.sim.head import Head, Pose
from ptzd.sim.profile import PROFILES, profile
from ptzd.sim.rig_truth import head_model
from ptzd.sim.scene import Scene, load_scene
from ptzd.sim.settings import SimSettings
from tests.bench.virtual import LoopClock, VirtualLoop

LATEST_S = {"polls": 0.7, "events": 0.3}
"""After true rest, by what tells the client of it."""
BUFFERS = {"move_spacing_s": 1.0, "report_lag_s": 0.2}
"""Settings for cameras that take up one command a second."""
GRID_S = 1e-3
"""Resolution of true rest."""
OUTSIDE = 0.05
"""Share of the targets beyond the limits."""
ROUND_TRIP_S = 0.005
"""Of a request on the network; the virtual clock has none of its own."""
NEAR = 0.5
"""Share of the targets near the present pose, as when a target is centred."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Move:
    """One move against the truth."""

    took_s: float
    """From the call to declared arrival."""
    late_s: float
    """From true rest to declared arrival; negative: declared too early."""
    pose_error_deg: float
    """Declared pose against the command, larger of pan and tilt."""
    optics_error_deg: float
    """Declared pose against where the optics truly point."""
    zoom_error: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Series:
    """Moves of one camera with one witness."""

    camera: str
    witness: str
    quantum_deg: float
    moves: list[Move]
    refused: int
    """Targets outside the limits, none of which was sent."""
    broken: list[str]
    """Laws that did not hold, one line each."""


def true_rest_s(head: Head, t_s: float) -> float:
    """When the motors stood and the optics were within one encoder step of their end for good."""
    stopped_s = max(axis.plan_at(t_s).end_s for axis in head.axes.values())
    end_s = max(head.rest_s(t_s), t_s)
    end = head.optical(end_s)
    for at_s in np.arange(end_s, stopped_s, -GRID_S):
        if _apart_deg(head, float(at_s), end) > head.profile.quantum_deg:
            return float(at_s) + GRID_S
    return stopped_s


def _apart_deg(head: Head, t_s: float, end: Pose) -> float:
    now = head.optical(t_s)
    return max(abs(math.remainder(now.pan_deg - end.pan_deg, 360.0)), abs(now.tilt_deg - end.tilt_deg))


def draw_target(draw: random.Random, limits: HeadLimits, here: HeadReading) -> HeadReading:
    """A target anywhere within the limits, near the present pose, or now and then outside."""
    kind = draw.random()
    if kind < OUTSIDE:
        return HeadReading(pan_deg=here.pan_deg, tilt_deg=limits.tilt_deg[1] + draw.uniform(0.01, 50), zoom=here.zoom)
    if kind < OUTSIDE + NEAR:
        pan, tilt = here.pan_deg + draw.gauss(0, 3), here.tilt_deg + draw.gauss(0, 3)
        zoom = here.zoom * math.exp(draw.gauss(0, 0.7))
        return HeadReading(
            pan_deg=min(max(pan, limits.pan_deg[0]), limits.pan_deg[1]),
            tilt_deg=min(max(tilt, limits.tilt_deg[0]), limits.tilt_deg[1]),
            zoom=round(min(max(zoom, limits.zoom[0]), limits.zoom[1])),
        )
    return HeadReading(
        pan_deg=draw.uniform(*limits.pan_deg), tilt_deg=draw.uniform(*limits.tilt_deg), zoom=draw.randint(1, 9999)
    )


async def series(name: str, witness: str, moves: int, seed: int, scene: Scene) -> Series:
    """Make ``moves`` random moves with one camera."""
    clock = LoopClock(asyncio.get_running_loop())
    settings = SimSettings(profile=name, seed=seed)
    kind = profile(name)
    camera = AxisCamera(settings, scene, head_model(kind.mount, kind), clock)
    with tempfile.NamedTemporaryFile("w", suffix=".password") as file:
        file.write(settings.password)
        file.flush()
        async with camera:
            if witness == "polls":
                camera.inject(Fault(kind=FaultKind.STATUS, status=404, path="*/wssession.cgi*"))
            camera.inject(Fault(kind=FaultKind.SLOW, delay_s=ROUND_TRIP_S, path="*/ptz.cgi*"))
            changes = BUFFERS if kind.timing.serialise_s else {}
            ptz = Ptz(url=camera.url, user=settings.user, password_file=file.name, size_px=(160, 120), fps=1, **changes)
            async with VapixHead(ptz, Limits(), clock, jitter=lambda: 0.5) as head:
                return await _moves(head, camera, witness, moves, random.Random(seed))


async def _moves(head: VapixHead, camera: AxisCamera, witness: str, moves: int, draw: random.Random) -> Series:
    limits, unit = await head.describe(), camera.unit
    found: list[Move] = []
    broken: list[str] = []
    refused = 0
    here = (await anext(head.polls())).reading
    for index in range(moves):
        target, sent, begun_s = draw_target(draw, limits, here), len(unit.orders), unit.clock.now_s()
        try:
            here = await head.move(target)
        except MoveStalled as stall:
            if limits.contains(target):
                broken.append(f"move {index}: {stall}")
            refused += 1
            broken += [f"move {index}: sent although outside"] * (len(unit.orders) != sent)
            continue
        found.append(_judged(unit.head, unit.clock.now_s(), begun_s, target, here))
    orders = [record.order for record in unit.orders]
    broken += [f"sent outside the limits: {order}" for order in orders if not _inside(order, limits)]
    quantum = unit.profile.quantum_deg
    broken += _broken(found, LATEST_S[witness], quantum, unit.profile.zoom_jitter)
    return Series(
        camera=unit.profile.name, witness=witness, quantum_deg=quantum, moves=found, refused=refused, broken=broken
    )


def _judged(truth: Head, now_s: float, begun_s: float, target: HeadReading, declared: HeadReading) -> Move:
    optics = truth.optical(max(now_s, truth.rest_s(now_s)))
    pan, sight = (math.remainder(declared.pan_deg - other, 360.0) for other in (target.pan_deg, optics.pan_deg))
    return Move(
        took_s=now_s - begun_s,
        late_s=now_s - true_rest_s(truth, now_s),
        pose_error_deg=max(abs(pan), abs(declared.tilt_deg - target.tilt_deg)),
        optics_error_deg=max(abs(sight), abs(declared.tilt_deg - optics.tilt_deg)),
        zoom_error=abs(declared.zoom - round(target.zoom)),
    )


def _inside(order: object, limits: HeadLimits) -> bool:
    return limits.contains(HeadReading(pan_deg=order.pan, tilt_deg=order.tilt, zoom=order.zoom))


def _broken(moves: list[Move], latest_s: float, quantum_deg: float, zoom_jitter: int) -> list[str]:
    lines = []
    for index, move in enumerate(moves):
        if move.late_s < 0:
            lines.append(f"arrival {index} declared {-move.late_s:.3f} s before rest")
        if move.late_s > latest_s:
            lines.append(f"arrival {index} declared {move.late_s:.3f} s after rest, more than {latest_s} s")
        if max(move.pose_error_deg, move.optics_error_deg) > quantum_deg:
            lines.append(f"arrival {index} is {move.pose_error_deg:.4f}°, {move.optics_error_deg:.4f}° off")
        if move.zoom_error > zoom_jitter + 1:
            lines.append(f"arrival {index} is {move.zoom_error:g} zoom units off")
    return lines


def table(found: list[Series]) -> str:
    """Markdown: one line per camera and witness."""
    head = (
        "| camera | witness | moves | command to declared arrival, s | true rest to declared arrival, s "
        "| pose − command, ° | pose − optics, ° | encoder step, ° |"
    )
    lines = [head, "|---|---|---|---|---|---|---|---|"]
    for one in found:
        took, late = _spread([m.took_s for m in one.moves]), _spread([m.late_s for m in one.moves])
        worst = max(m.pose_error_deg for m in one.moves), max(m.optics_error_deg for m in one.moves)
        least, count = min(m.late_s for m in one.moves), f"{len(one.moves)} + {one.refused} refused"
        errors = f"{worst[0]:.4f} | {worst[1]:.4f} | {one.quantum_deg:.4f}"
        lines.append(f"| {one.camera} | {one.witness} | {count} | {took} | {least:.2f} / {late} | {errors} |")
    return "\n".join(lines)


def _spread(values: list[float]) -> str:
    return " / ".join(f"{value:.2f}" for value in (*np.percentile(values, (50, 95)), max(values)))


def witnesses(name: str) -> tuple[str, ...]:
    """What can tell of rest on a camera of this kind."""
    return ("polls", "events") if profile(name).has_events else ("polls",)


def run(name: str, witness: str, moves: int, seed: int, scene: Scene) -> Series:
    """:func:`series` on a loop of its own."""
    with asyncio.Runner(loop_factory=VirtualLoop) as runner:
        return runner.run(series(name, witness, moves, seed, scene))


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--moves", type=int, default=1000, help="of each camera, shared by its witnesses")
    parser.add_argument("--profile", choices=sorted(PROFILES), action="append")
    parser.add_argument("--witness", choices=sorted(LATEST_S), action="append")
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    scene, found = load_scene("room"), []
    for name in arguments.profile or PROFILES:
        tellers = arguments.witness or witnesses(name)
        for number, witness in enumerate(tellers):
            moves = (arguments.moves + number) // len(tellers)
            found.append(run(name, witness, moves, arguments.seed + number, scene))
            print(table(found[-1:]).splitlines()[-1], file=sys.stderr)
            for line in found[-1].broken:
                print(f"{name}, {witness}: {line}", file=sys.stderr)
    print(table(found))
    print("Arrival: median / 95 % / latest; from true rest: earliest / median / 95 % / latest. Errors: the largest.")
    return int(any(one.broken for one in found))


if __name__ == "__main__":
    sys.exit(main())
