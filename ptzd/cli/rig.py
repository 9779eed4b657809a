"""Commands that run a rig: the daemon, its check, the simulator, the demo."""

from __future__ import annotations

import argparse
import asyncio
import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec
from rich.table import Table

from ptzd.cli import terminal
from ptzd.plain import plain, plain_lines

if TYPE_CHECKING:
    from ptzd.app.loading import Loaded


def run(arguments: argparse.Namespace) -> int:
    """Serve until told to stop."""
    from ptzd.app import daemon, journal
    from ptzd.app.loading import load

    loaded = load(arguments.config, shadow=arguments.shadow)
    journal.set_up()
    serves = f"ptzd: rig {loaded.config.rig} serves requests{', moves nothing' if loaded.config.shadow.enabled else ''}"
    asyncio.run(daemon.run(loaded, ready=lambda: print(serves, flush=True)))
    return 0


def check(arguments: argparse.Namespace) -> int:
    """Say whether the daemon could run with these settings."""
    from ptzd.app.checking import check_cameras, check_devices, check_files
    from ptzd.app.loading import load

    loaded = load(arguments.config)
    for line in (*check_files(loaded), *check_devices(loaded)):
        print(line)
    if arguments.connect or arguments.timing:
        for line in asyncio.run(check_cameras(loaded, timing=arguments.timing)):
            print(line)
    if arguments.zones is not None:
        _draw_zones(arguments, loaded)
    return 0


def _draw_zones(arguments: argparse.Namespace, loaded: Loaded) -> None:
    """Over a picture of the camera, a given one, or none."""
    from ptzd.app.checking import fisheye_picture
    from ptzd.app.zone_sheet import read_picture, zone_sheet
    from ptzd.cli.offline import write_picture
    from ptzd.jpeg.pixels import decode_bgr

    pixels = None
    if arguments.picture is not None:
        pixels = read_picture(arguments.picture)
    elif arguments.connect:
        pixels = decode_bgr(asyncio.run(fisheye_picture(loaded)))
    write_picture(arguments.zones, zone_sheet(loaded, pixels))
    print(f"zones        drawn into {arguments.zones}")


def presets(arguments: argparse.Namespace) -> int:
    """Print the camera's own presets as places, or write them into a new file; exit 1 when some are left out."""
    from ptzd.app.importing import import_presets
    from ptzd.app.loading import load

    out: Path | None = arguments.out
    if out is not None and out.exists():
        print(f"{out} exists and stays as it is; give another --out and copy what you want", file=sys.stderr)
        return 1
    imported = asyncio.run(import_presets(load(arguments.config)))
    for sentence in imported.left_out:
        print(plain(sentence), file=sys.stderr)
    if out is None:
        print(imported.text(), end="")
    else:
        out.write_text(imported.text())
        print(f"{out}: {len(imported.places)} places")
    return 1 if imported.left_out else 0


def sim(arguments: argparse.Namespace) -> int:
    """Run the simulated rig until interrupted."""
    from ptzd.app import simulate

    if arguments.list:
        print("\n".join(simulate.names()))
        return 0
    wanted = simulate.Wanted(
        scene=arguments.scene,
        profile=arguments.profile,
        ports=(arguments.port, arguments.fisheye_port, arguments.truth_port),
        user=arguments.user,
        password_file=arguments.password_file,
        faults=arguments.faults,
        write_config=arguments.write_config,
        bus=arguments.bus,
    )

    def ready(facts: dict[str, str]) -> None:
        if arguments.json:
            print(json.dumps(facts), flush=True)
        else:
            print("\n".join(f"{name:12} {value}" for name, value in facts.items()), flush=True)

    asyncio.run(simulate.serve(wanted, ready))
    return 0


def demo(arguments: argparse.Namespace) -> int:
    """Show all of it on a simulated rig; exit 0 when every box was locked within the tolerance."""
    from ptzd.app.demo import TOLERANCE_DEG, Report, run_demo

    console = terminal.console(stderr=arguments.json, soft_wrap=True)

    def say(text: object) -> None:
        console.print(plain_lines(text) if isinstance(text, str) else text)

    report: Report = asyncio.run(run_demo(arguments.scene, arguments.out, say, boxes=arguments.boxes))
    if arguments.json:
        document = {
            "outcome": "locked" if report.good else "failed",
            "requests": [
                {
                    "name": shot.name,
                    "box": list(shot.box),
                    "outcome": shot.result.outcome,
                    "error_deg": shot.error_deg,
                    "elapsed_s": round(shot.elapsed_s, 3),
                }
                for shot in report.shots
            ],
            "log": str(report.log),
            "sheet": str(report.sheet),
        }
        print(msgspec.json.encode(document).decode())
    else:
        table = Table("box", "outcome", "seconds to lock", f"error, deg (≤ {TOLERANCE_DEG:g})", "probability")
        for shot in report.shots:
            error = "–" if shot.error_deg is None else f"{shot.error_deg:.3f}"
            probability = "–" if shot.result.probability is None else f"{shot.result.probability:.3f}"
            table.add_row(shot.name, shot.result.outcome, f"{shot.elapsed_s:.1f}", error, probability)
        console.print(table)
        console.print(f"log    {report.log}\nsheet  {report.sheet}\nreplay ptzd replay --recompute {report.log}")
    return 0 if report.good else 1


def install_service(arguments: argparse.Namespace) -> int:
    """Write the service's files for this installation and enable it; it starts when told to."""
    from ptzd.app import installing

    del arguments
    for path in installing.write_files(Path(sys.argv[0])):
        print(path)
    installing.activate()
    print("enabled; write /etc/ptzd/ptzd.yaml, then: systemctl start ptzd")
    return 0
