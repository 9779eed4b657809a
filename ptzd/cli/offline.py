"""Commands that need no camera and no bus: files in, files and answers out."""

from __future__ import annotations

import argparse
import json
import math
import sys
from collections.abc import Iterable
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from ptzd.app import locating
from ptzd.app.loading import load_config
from ptzd.control.ranks import rank_mermaid
from ptzd.control.states import mermaid


def locate(arguments: argparse.Namespace) -> int:
    """Find a region in pictures; exit 0 when found."""
    located = locating.locate(
        calibration=arguments.calibration,
        fisheye=arguments.fisheye,
        box=arguments.box,
        views=arguments.views,
        matcher=arguments.matcher,
        range_m=arguments.range,
    )
    if arguments.draw is not None:
        write_picture(arguments.draw, locating.draw(located))
    document = locating.document(located)
    if arguments.json:
        print(json.dumps(document))
    elif locating.found(located):
        print(f"found in view {document['view']}: pan {document['pan_deg']:.3f}°, tilt {document['tilt_deg']:.3f}°")
        print(
            f"range {locating.range_of(located)}, probability {document['probability']:.3f}, VAPIX {document['vapix']}"
        )
    else:
        print(f"{document['outcome']}: {document['reason']}")
    return 0 if locating.found(located) else 1


def write_picture(path: Path, pixels: NDArray[np.uint8]) -> None:
    """Write a picture in the format that its name says."""
    if not cv2.haveImageWriter(str(path)):
        raise locating.DataError(f"{path}: no format of this name; end it in .png or .jpg")
    if not cv2.imwrite(str(path), pixels):
        raise locating.DataError(f"{path}: the picture cannot be written; does the folder exist?")


def plan(arguments: argparse.Namespace) -> int:
    """List the views of a scan."""
    config = None if arguments.config is None else load_config(arguments.config)
    planned, rig = locating.plan(
        calibration=arguments.calibration,
        box=arguments.box,
        zoom=arguments.zoom,
        range_m=arguments.range,
        config=config,
    )
    views = [
        {
            "pan_deg": round(view.reading.pan_deg, 4),
            "tilt_deg": round(view.reading.tilt_deg, 4),
            "zoom": view.reading.zoom,
            "hfov_deg": round(math.degrees(view.hfov_rad), 4),
        }
        for view in planned.views
    ]
    if arguments.json:
        print(json.dumps(views))
    else:
        for number, view in enumerate(views, 1):
            print(f"{number}: " + ", ".join(f"{name} {value:g}" for name, value in view.items()))
    if planned.unreachable:
        outside = " and outside the zones" if config is not None and config.zones else ""
        missing = planned.unreachable_in_words(metric=rig.metric)
        print(f"ptzd: no pose within the limits{outside} shows {missing}", file=sys.stderr)
    return 0 if views else 1


def schema(arguments: argparse.Namespace) -> int:
    """Print the JSON Schema of one message, or the names of all."""
    from ptzd.app.clients import message_schema, message_types

    names = message_types()
    if arguments.type is None:
        print("\n".join(names))
    elif arguments.type in names:
        print(json.dumps(message_schema(arguments.type), indent=2))
    else:
        raise locating.DataError(f"schema: no message {arguments.type}; there are {', '.join(names)}")
    return 0


def states(arguments: argparse.Namespace) -> int:
    """Print the state diagram, or that of the ranks."""
    print(rank_mermaid() if arguments.ranks else mermaid())
    return 0


def log_info(arguments: argparse.Namespace) -> int:
    """What a log holds, told per request."""
    from ptzd.app import logs

    return _print_lines(logs.info(arguments.file, as_json=arguments.json))


def log_recover(arguments: argparse.Namespace) -> int:
    """Repair a torn log."""
    from ptzd.app import logs

    return _print_lines(logs.recovered(arguments.file, as_json=arguments.json))


def log_export(arguments: argparse.Namespace) -> int:
    """Write tables, pages and pictures of a log."""
    from ptzd.app import logs

    lines = logs.exported(
        arguments.file, arguments.out, arguments.request, pictures=arguments.pictures, as_json=arguments.json
    )
    return _print_lines(lines)


def _print_lines(lines: Iterable[str]) -> int:
    for line in lines:
        print(line)
    return 0
