"""`ptzd sim`: the simulated rig, and settings that make a daemon use it."""

from __future__ import annotations

import asyncio
import signal
from collections.abc import Callable
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path

import yaml

from ptzd.app.locating import DataError
from ptzd.documents import read_regular
from ptzd.sim.profile import PROFILES
from ptzd.sim.rig import SimRig
from ptzd.sim.settings import SimSettings

RIG = "demo"
DEFAULT_PASSWORD = "pan-tilt-zoom"  # noqa: S105  # of a camera that exists on loopback only
STARVED_S = 20.0
"""Silence of a simulated camera that means its loss: it shares the processor with the daemon, and may be starved."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Wanted:
    """What the command line asks for."""

    scene: str
    profile: str
    ports: tuple[int, int, int]
    """Camera, fisheye, truth; 0 = any free one."""
    user: str
    password_file: Path | None
    faults: Path | None
    write_config: Path | None
    bus: str
    """Zenoh endpoint in the written settings."""


def names() -> list[str]:
    """Scenes and profiles, a line each."""
    folders = (item for item in files("ptzd.sim").joinpath("scenes").iterdir() if item.joinpath("scene.yaml").is_file())
    return [
        *(f"scene {item.name}" for item in sorted(folders, key=lambda item: item.name)),
        *(f"profile {name}" for name in sorted(PROFILES)),
    ]


async def serve(wanted: Wanted, ready: Callable[[dict[str, str]], None]) -> None:
    """Run the rig until SIGTERM or SIGINT; ``ready`` gets its addresses."""
    password = _password(wanted.password_file)
    camera_port, fisheye_port, truth_port = wanted.ports
    settings = SimSettings(
        scene=wanted.scene,
        profile=wanted.profile,
        user=wanted.user,
        password=password,
        ptz_port=camera_port,
        fisheye_port=fisheye_port,
        truth_port=truth_port,
        faults=None if wanted.faults is None else str(wanted.faults),
    )
    stop = asyncio.Event()
    loop = asyncio.get_running_loop()
    for number in (signal.SIGTERM, signal.SIGINT):
        loop.add_signal_handler(number, stop.set)
    async with SimRig(settings) as rig:
        facts = {"ptz_url": ptz_url(rig), "fisheye_url": rig.fisheye_url, "truth_url": rig.truth_url}
        if wanted.write_config is not None:
            facts["config"] = str(write_config(rig, wanted.write_config, bus=wanted.bus, password=password))
        ready(facts)
        await stop.wait()


def ptz_url(rig: SimRig) -> str:
    """Where a daemon should ask: over TLS when the camera has it."""
    return rig.camera_url if rig.camera.certificate is None else rig.camera.https_url


def write_config(rig: SimRig, folder: Path, *, bus: str, password: str) -> Path:
    """Write ``ptzd.yaml``, ``rig.yaml`` and the password file for this rig; returns the path of the first."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "rig.yaml").write_text(rig.calibration_text())
    secret = folder / "password"
    secret.touch(mode=0o600)
    secret.write_text(password + "\n")
    path = folder / "ptzd.yaml"
    path.write_text(yaml.safe_dump(_config(rig, bus), sort_keys=False))
    return path


def _config(rig: SimRig, bus: str) -> dict[str, object]:
    certificate, profile = rig.camera.certificate, rig.camera.unit.profile
    pinned = {} if certificate is None else {"certificate_sha256": certificate.sha256}
    return {
        "rig": RIG,
        "calibration": "rig.yaml",
        "fisheye": {
            "source": "http",
            "url": rig.fisheye_url,
            "latency_s": rig.settings.fisheye_latency_s,
            "stall_s": STARVED_S,
        },
        "ptz": {
            "url": ptz_url(rig),
            "user": rig.settings.user,
            "password_file": "password",
            "size_px": list(rig.settings.ptz_size_px),
            "stall_s": STARVED_S,
            "steer_top_deg_s": [profile.pan.v_max, profile.tilt.v_max],
            "steer_exponent": profile.continuous_exponent,
            **pinned,
        },
        "bus": {"listen": [bus]},
        "log": {"directory": "log", "min_free_bytes": 200_000_000},
    }


def _password(path: Path | None) -> str:
    if path is None:
        return DEFAULT_PASSWORD
    try:
        # what a shell makes of `<(command)`: it is read once, and whoever typed it waits for his own command
        handed_over = path.is_relative_to("/dev/fd")
        data = path.read_bytes() if handed_over else read_regular(path)
        return data.decode().splitlines()[0]
    except OSError as error:
        raise DataError(f"{path}: {error.strerror}") from None
    except (UnicodeDecodeError, IndexError):
        raise DataError(f"{path}: no password in its first line") from None
