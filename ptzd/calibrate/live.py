"""`ptzd calibrate fisheye --live`, `zoom --live`: pictures of a board, taken by themselves when they add something."""

from __future__ import annotations

import asyncio
import dataclasses
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from ptzd.calibrate.capture import write_shots
from ptzd.calibrate.parts import Shot
from ptzd.calibration.detect import Grey, detect
from ptzd.calibration.guide import CELLS, Action, Advice, Goal, Guide, lit_cells
from ptzd.calibration.pictures import SUFFIXES, list_pictures, read_grey
from ptzd.calibration.target import Target
from ptzd.errors import CalibrationError, DeviceGarbled, DeviceLost
from ptzd.geometry.types import Array
from ptzd.jpeg.pixels import decode_grey
from ptzd.model import HeadReading
from ptzd.ports import Clock, FrameSource, Picture, PtzHead

Show = Callable[[Advice], None]


async def record(source: FrameSource, target: Target, folder: Path, goal: Goal, show: Show) -> Path:
    """Watch a fisheye until its pictures are enough; they are kept in a folder.

    Pictures that lie there from an earlier run count.

    Parameters
    ----------
    source : FrameSource
        The fisheye, open.
    target : Target
        The board.
    folder : Path
        Where the pictures go; it exists.
    goal : Goal
        When it is enough.
    show : callable
        Told what every picture was to the guide.

    Raises
    ------
    CalibrationError
        When the source ends before it is enough.
    """
    guide: Guide | None = None
    while guide is None or not guide.enough:
        try:
            guide = await _watch(source, target, folder, goal, show, guide)
        except DeviceLost as error:
            show(Advice(action=Action.NO_BOARD, text=f"no picture: {error}", covered=0.0, taken=0))
            continue
        if guide is None or not guide.enough:
            raise CalibrationError(
                f"fisheye: the source ended before it was enough; hold the board {_wanted(guide)}; the pictures so far "
                f"are kept in {folder}"
            )
    return folder


async def _watch(
    source: FrameSource, target: Target, folder: Path, goal: Goal, show: Show, guide: Guide | None
) -> Guide | None:
    async for picture in source.pictures():
        grey, pixels = await asyncio.to_thread(_board, picture, target)
        if grey is None:
            continue
        if guide is None:
            guide = await asyncio.to_thread(_begin, grey, target, folder, goal)
        advice = guide.look(picture.t_arrival_ns / 1e9, pixels)
        if advice.action is Action.TAKE:
            await asyncio.to_thread(_keep, folder, picture)
        show(advice)
        if guide.enough:
            break
    return guide


async def zoom_pictures(
    head: PtzHead, clock: Clock, target: Target, work: Path, zooms: Sequence[float], goal: Goal, show: Show
) -> Path:
    """Drive a head through zooms and take pictures of a board that somebody holds, at each until enough.

    It looks where it looked.

    Returns
    -------
    Path
        The list of pictures with their zoom.
    """
    folder = work / "zoom"
    await asyncio.to_thread(folder.mkdir, parents=True, exist_ok=True)
    limits, shots = await head.describe(), list[Shot]()
    _, start = await head.grab(clock.now_ns())
    for zoom in (zoom for zoom in zooms if limits.zoom[0] <= zoom <= limits.zoom[1]):
        rest = await head.move(dataclasses.replace(start.reading, zoom=float(zoom)))
        guide: Guide | None = None
        while guide is None or not guide.enough:
            picture, view = await head.grab(clock.now_ns())
            grey, pixels = await asyncio.to_thread(_board, picture, target)
            if grey is None:
                continue
            guide = guide or Guide((grey.shape[1], grey.shape[0]), np.ones((CELLS, CELLS), bool), goal)
            advice = guide.look(picture.t_arrival_ns / 1e9, pixels)
            if advice.action is Action.TAKE:
                name = f"zoom/{zoom:g}_{advice.taken:02}.jpg"
                await asyncio.to_thread((work / name).write_bytes, picture.jpeg)
                shots.append(_shot(name, view.reading, zoom))
            show(dataclasses.replace(advice, text=f"zoom {rest.zoom:g}: {advice.text}"))
    return await asyncio.to_thread(write_shots, work / "zoom.json", shots)


def _shot(name: str, reading: HeadReading, zoom: float) -> Shot:
    return Shot(image=name, pan_deg=reading.pan_deg, tilt_deg=reading.tilt_deg, zoom=float(zoom))


def _board(picture: Picture, target: Target) -> tuple[Grey | None, Array | None]:
    try:
        grey = decode_grey(picture.jpeg)
    except DeviceGarbled:
        return None, None
    view = detect(grey, target, "").view
    return grey, None if view is None else view.pixels


def _begin(grey: Grey, target: Target, folder: Path, goal: Goal) -> Guide:
    """A guide that knows the pictures of an earlier run."""
    guide = Guide((grey.shape[1], grey.shape[0]), lit_cells(grey), goal)
    for path in list_pictures(folder) if _pictures_in(folder) else []:
        earlier = read_grey(path)
        if earlier is None or earlier.shape != grey.shape:
            raise CalibrationError(
                f"{path}: not a picture of {grey.shape[1]}×{grey.shape[0]} px like the fisheye's; give another folder"
            )
        view = detect(earlier, target, path.name).view
        if view is not None:
            guide.keep(view.pixels)
    return guide


def _pictures_in(folder: Path) -> bool:
    return any(path.suffix.lower() in SUFFIXES for path in folder.iterdir())


def _keep(folder: Path, picture: Picture) -> None:
    """The camera's own bytes, numbered on."""
    taken = [int(path.stem) for path in folder.glob("*.jpg") if path.stem.isdigit()]
    (folder / f"{max(taken, default=0) + 1:03}.jpg").write_bytes(picture.jpeg)


def _wanted(guide: Guide | None) -> str:
    return "before the lens" if guide is None else guide.wanted()
