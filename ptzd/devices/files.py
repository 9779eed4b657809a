"""Pictures from a folder, as a fisheye: for trying a calibration or a request on what was taken before."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import AsyncGenerator, Iterator
from pathlib import Path
from types import TracebackType
from typing import Self

from ptzd.config import FilesSource
from ptzd.documents import read_regular
from ptzd.errors import DeviceError, DeviceGarbled, DeviceLost, DeviceRefused
from ptzd.jpeg.pixels import decode_file_bgr, encode_jpeg
from ptzd.jpeg.walk import whole_length
from ptzd.model import FrameRef
from ptzd.ports import Clock, Picture

JPEG_SUFFIXES = frozenset({".jpg", ".jpeg"})
ENCODED_SUFFIXES = frozenset({".png"})
LOOK_AGAIN_S = 0.5
"""Between two looks at a folder that has nothing (more) to show."""

_log = logging.getLogger(__name__)


class FilesFisheye:
    """A :class:`ptzd.ports.FrameSource` that shows the files of a folder in the order of their names.

    JPEG files pass untouched; PNG files are encoded. A reader that is slow slows the show down: no picture is skipped.
    Unlike a camera's, the pictures' times are those of showing them. A file that is not a whole picture is passed over
    and counted as lost.

    Parameters
    ----------
    settings : FilesSource
        Folder, rate, whether to begin again at the end.
    clock : Clock
        Stamps the pictures.
    """

    def __init__(self, settings: FilesSource, clock: Clock) -> None:
        self._settings = settings
        self._folder = Path(settings.path)
        self._clock = clock
        self._showing: AsyncGenerator[Picture, None] | None = None
        self._next_number = 0
        self._last_shown = ""
        self._loss_told = False

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._showing is not None:
            await self._showing.aclose()

    def pictures(self) -> AsyncGenerator[Picture, None]:
        """Pictures from now on; after the end of a folder that is not looped, those that are added behind it."""
        self._showing = self._show()
        return self._showing

    async def _show(self) -> AsyncGenerator[Picture, None]:
        loop = asyncio.get_running_loop()
        due_s = loop.time()
        lost = 0
        while True:
            names = await self._names_or_wait()
            shown = 0
            for name in names:
                await asyncio.sleep(due_s - loop.time())
                due_s = max(due_s, loop.time()) + 1 / self._settings.fps
                self._last_shown = name
                self._next_number += 1
                try:
                    jpeg = await asyncio.to_thread(read_picture, self._folder / name)
                except DeviceError as error:
                    _log.warning("%s", error)
                    lost += 1
                    continue
                self._loss_told = False
                yield self._picture(jpeg, lost)
                shown, lost = shown + 1, 0
            if not shown:
                self._tell_loss(f"{self._folder}: none of the {len(names)} pictures is whole; replace them")

    async def _names_or_wait(self) -> list[str]:
        """Names that are due; raises once, then waits until there are some."""
        while True:
            try:
                names = await asyncio.to_thread(picture_names, self._folder)
            except DeviceError as error:
                self._tell_loss(str(error))
                names = []
            due = names if self._settings.loop else [name for name in names if name > self._last_shown]
            if due:
                return due
            if names:
                self._tell_loss(f"{self._folder}: the folder is at its end; set loop: true to begin again")
            await asyncio.sleep(LOOK_AGAIN_S)

    def _tell_loss(self, message: str) -> None:
        if not self._loss_told:
            self._loss_told = True
            raise DeviceLost(message)

    def _picture(self, jpeg: bytes, lost: int) -> Picture:
        now_ns = self._clock.now_ns()
        frame = FrameRef(seq=self._next_number - 1, t_capture_ns=now_ns)
        return Picture(frame=frame, t_arrival_ns=now_ns, jpeg=jpeg, lost_before=lost)


def picture_names(folder: Path) -> list[str]:
    """Names of the pictures in a folder, in order.

    Raises
    ------
    DeviceLost
        There is no such folder or no picture in it.
    DeviceRefused
        The folder cannot be read.
    """
    try:
        names = sorted(_pictures_in(folder))
    except (FileNotFoundError, NotADirectoryError):
        raise DeviceLost(f"{folder}: no such folder; set fisheye.path") from None
    except PermissionError:
        raise DeviceRefused(f"{folder}: not allowed to read this folder") from None
    if not names:
        raise DeviceLost(f"{folder}: no picture in this folder; put .jpg or .png files there")
    return names


def _pictures_in(folder: Path) -> Iterator[str]:
    suffixes = JPEG_SUFFIXES | ENCODED_SUFFIXES
    return (entry.name for entry in folder.iterdir() if entry.suffix.lower() in suffixes)


def read_picture(path: Path) -> bytes:
    """Read a picture as JPEG: the file's own bytes, or a PNG file encoded.

    Raises
    ------
    DeviceGarbled
        The file is not a whole picture.
    DeviceLost
        It cannot be read.
    """
    try:
        data = read_regular(path)
    except OSError as error:
        raise DeviceLost(f"{path}: {error.strerror}") from error
    if path.suffix.lower() in JPEG_SUFFIXES:
        length = whole_length(data, len(data))
        if length is None:
            raise DeviceGarbled(f"{path}: not a whole JPEG picture; passed over")
        return data[:length]
    try:
        return encode_jpeg(decode_file_bgr(data))
    except DeviceGarbled as error:
        raise DeviceGarbled(f"{path}: {error}; passed over") from None
