"""Boards of a folder of pictures, every picture judged by name."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import cv2

from ptzd.calibration.detect import Detection, Grey, detect, size_seen
from ptzd.calibration.target import Target, TargetKind
from ptzd.calibration.views import BoardView, Status, ViewVerdict
from ptzd.documents import read_regular
from ptzd.errors import CalibrationError, DeviceGarbled
from ptzd.jpeg.pixels import decode_file

SUFFIXES = {".jpg", ".jpeg", ".png", ".bmp", ".tif", ".tiff", ".pgm"}
THREADS = 2
FEW = 0.25
"""When fewer of the pictures show the board, what is looked for is not what is shown."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Boards:
    """What a folder holds."""

    size_px: tuple[int, int]
    views: tuple[BoardView, ...]
    refused: tuple[ViewVerdict, ...]
    paths: dict[str, Path]


def list_pictures(folder: Path) -> list[Path]:
    """Pictures of a folder in natural order: 2 before 10.

    Raises
    ------
    CalibrationError
        When there is no such folder or no picture in it.
    """
    if not folder.is_dir():
        raise CalibrationError(f"{folder}: no such folder; give the folder with the pictures of the board")
    paths = [path for path in folder.iterdir() if path.suffix.lower() in SUFFIXES]
    if not paths:
        raise CalibrationError(f"{folder}: no pictures; expected files ending in {', '.join(sorted(SUFFIXES))}")
    return sorted(paths, key=lambda path: (len(path.stem), path.stem))


def read_grey(path: Path) -> Grey | None:
    """The picture as stored (a turned camera stays turned), or None when it is no whole, undamaged picture."""
    try:
        return decode_file(_bytes(path))
    except DeviceGarbled:
        return None


def _bytes(path: Path) -> bytes:
    try:
        return read_regular(path)
    except OSError as error:
        raise CalibrationError(f"{path}: {error.strerror}") from None


def read_boards(
    source: Path | Sequence[Path],
    target: Target,
    progress: Callable[[str, int, int], None] = lambda text, done, total: None,
) -> Boards:
    """Find the board in all pictures.

    Parameters
    ----------
    source : Path or sequence of Path
        A folder, or files.
    target : Target
        What to look for.
    progress : callable
        Told the name of each picture and how many of how many are done.

    Raises
    ------
    CalibrationError
        When the pictures are of several sizes, or none shows the board; with what is seen instead.
    """
    paths = list_pictures(source) if isinstance(source, Path) else list(source)
    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        with ThreadPoolExecutor(THREADS) as pool:
            results = []
            for path, result in zip(paths, pool.map(lambda path: _one(path, target), paths), strict=True):
                results.append(result)
                progress(f"{path.name}: {result[0].status}", len(results), len(paths))
    finally:
        cv2.setNumThreads(threads)
    size_px = _one_size(paths, [size for _, size in results])
    views = tuple(found.view for found, _ in results if found.view is not None)
    refused = tuple(
        ViewVerdict(name=path.name, status=found.status, reason=found.reason)
        for path, (found, _) in zip(paths, results, strict=True)
        if found.view is None
    )
    if len(views) < FEW * len(paths):
        raise CalibrationError(_nothing(paths, target, refused))
    return Boards(size_px=size_px, views=views, refused=refused, paths={path.name: path for path in paths})


def _one(path: Path, target: Target) -> tuple[Detection, tuple[int, int] | None]:
    try:
        grey = decode_file(_bytes(path))
    except DeviceGarbled as error:
        return Detection(status=Status.UNREADABLE, reason=str(error)), None
    return detect(grey, target, path.name), (grey.shape[1], grey.shape[0])


def _one_size(paths: Sequence[Path], sizes: Sequence[tuple[int, int] | None]) -> tuple[int, int]:
    counts = Counter(size for size in sizes if size is not None)
    if not counts:
        raise CalibrationError(f"{paths[0].parent}: none of the {len(paths)} files can be decoded as a picture")
    most = counts.most_common(1)[0][0]
    odd = [path.name for path, size in zip(paths, sizes, strict=True) if size not in (most, None)]
    if odd:
        raise CalibrationError(
            f"pictures: {len(odd)} of {len(paths)} are not {most[0]}×{most[1]} px like the others "
            f"({', '.join(odd[:5])}); take all at the resolution that the daemon will use"
        )
    return most


def _nothing(paths: Sequence[Path], target: Target, refused: Sequence[ViewVerdict]) -> str:
    wanted = f"{target.kind} of {target.columns}×{target.rows} points"
    reasons = Counter(verdict.status for verdict in refused)
    if reasons[Status.MIRRORED]:
        return f"pictures: {reasons[Status.MIRRORED]} of {len(paths)} are mirrored; switch mirroring off in the camera"
    if reasons[Status.EDGE]:
        return f"pictures: the board reaches the border in all {len(paths)} pictures; keep it 5 px inside"
    if target.kind is TargetKind.CHESSBOARD:
        for path in paths[:3]:
            grey = read_grey(path)
            seen = size_seen(grey) if grey is not None else None
            if seen is not None and set(seen) != {target.columns, target.rows}:
                return f"pictures: no {wanted}, but {path.name} shows one of {seen[0]}×{seen[1]}; give that size"
    return (
        f"pictures: a {wanted} in {len(paths) - len(refused)} of {len(paths)} only; check the kind and count of "
        "points, that the whole board with its white rim is visible, and light and sharpness"
    )
