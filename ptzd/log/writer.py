"""The black box as the pump sees it: calls that enqueue and return."""

from __future__ import annotations

import asyncio
import contextlib
import threading
from dataclasses import asdict, dataclass
from pathlib import Path
from types import TracebackType
from typing import Self

import msgspec

from ptzd.config import LogSettings
from ptzd.control.commands import Command, PinFrame, ReleaseFrames, RunMatch
from ptzd.control.events import Event, MatchFailed, MatchFinished, Snapshot, ViewTaken
from ptzd.errors import LogError
from ptzd.log import retention
from ptzd.log.codec import encode
from ptzd.log.inbox import Adopt, Cut, End, Inbox, Item, Record, Settle
from ptzd.log.keeper import PATIENCE_S
from ptzd.log.notes import Level
from ptzd.log.protobuf import NS, CompressedImage
from ptzd.log.recent_pictures import RecentPictures
from ptzd.log.recover import recover_directory
from ptzd.log.run_info import RunInfo
from ptzd.log.scribe import Illustrate, Scribe, nothing
from ptzd.log.topics import COMMAND, EVENT, FISHEYE_IMAGE, IMAGES, PTZ_IMAGE
from ptzd.log.topics import topic as find_topic
from ptzd.model import FrameRef
from ptzd.ports import Clock, Picture

FRAME_IDS = {FISHEYE_IMAGE: "fisheye", PTZ_IMAGE: "camera"}
"""Coordinate frame of each picture topic, as ``/tf`` names it."""
LATE_S = 5.0
"""How long a picture can still be asked for, s; longer than a request may lag behind its frame."""
_MAX_NS = 1 << 63


@dataclass(frozen=True, slots=True, kw_only=True)
class LogStats:
    """How the log is doing."""

    messages: int
    pictures: int
    pictures_dropped: int
    """The disk or the queue had no room."""
    pictures_skipped: int
    """Left out by ``fisheye_every_n``."""
    decisions_lost: int
    """Always 0 unless the disk was gone for very long."""
    bytes: int
    files: int
    waiting: int
    """Records in the queue."""
    degraded: str
    """Why not everything is written; empty when it is."""
    notes: tuple[str, ...]
    """What recovery found at the start."""


class McapLog:
    """Writes all that the core is told and answers, and the pictures, to MCAP files: :class:`ptzd.ports.EventLog`.

    Pictures are left out by ``fisheye_every_n`` and when the queue is full. One that a command or event then names as
    used (``PinFrame``, ``RunMatch``, ``ViewTaken``) is written late, with its own times, and again into every file that
    begins while it is in use, so that each file replays alone; the pump need not care.

    Parameters
    ----------
    settings : LogSettings
        Directory, decimation, rotation, retention, queue.
    run : RunInfo
        Goes to the head of every file.
    clock : Clock
        For names and for the log's own messages.
    illustrate : Illustrate
        Makes documents for viewers out of decisions, in the writer's thread.
    late_s : float
        How long pictures can still be asked for, s; they are held by reference for this long.
    """

    def __init__(
        self,
        settings: LogSettings,
        run: RunInfo,
        clock: Clock,
        *,
        illustrate: Illustrate = nothing,
        late_s: float = LATE_S,
    ) -> None:
        self._settings = settings
        self._rig = run.rig
        self._directory = Path(settings.directory)
        self._inbox = Inbox(settings.queue_frames)
        self._scribe = Scribe(settings, run, clock, self._inbox, illustrate)
        self._thread = threading.Thread(target=self._scribe.run, name="ptzd-log")
        self._pictures = RecentPictures(int(late_s * NS))
        self._counts = dict.fromkeys(IMAGES, 0)
        self._skipped = self._refused = 0
        self._snapshots = 0
        self._closed = False
        self._notes: tuple[str, ...] = ()

    async def __aenter__(self) -> Self:
        """Recover what a crash left behind and begin a file.

        Raises
        ------
        LogError
            The directory cannot be used.
        """
        try:
            await asyncio.to_thread(self._open)
        except OSError as error:
            raise LogError(
                f"{self._directory}: the log cannot be written: {error.strerror}; see log.directory"
            ) from None
        self._thread.start()
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Write what waits and close the file."""
        self._closed = True
        self._inbox.put(End())
        await asyncio.to_thread(self._thread.join)

    def _open(self) -> None:
        self._directory.mkdir(parents=True, exist_ok=True)
        self._scribe.make_room()
        self._notes = tuple(recover_directory(self._directory))
        self._scribe.open()
        for note in self._notes:
            self._scribe.say(Level.WARNING, note)

    def event(self, sequence: int, t_ns: int, event: Event) -> None:
        """What the core is about to be told, and when.

        Raises
        ------
        LogError
            The event cannot be written exactly, or the writer has ended.
        """
        name, body = encode(event)
        self._decision(EVENT, sequence, t_ns, name, body, event)
        match event:
            case ViewTaken():
                self.require(PTZ_IMAGE, event.view.frame)
            case Snapshot():
                self._snapshots += 1
            case MatchFinished() | MatchFailed():
                self._pictures.release(_match(event.match_id))
            case _:
                pass

    def command(self, sequence: int, t_ns: int, command: Command) -> None:
        """What the core answered to the event of this sequence number; errors as for :meth:`event`."""
        name, body = encode(command)
        self._decision(COMMAND, sequence, t_ns, name, body, command)
        match command:
            case PinFrame():
                self.require(FISHEYE_IMAGE, command.frame)
                self._pictures.use(_request(command.request_id), FISHEYE_IMAGE, command.frame)
                self._pictures.let_go(_request(command.request_id), FISHEYE_IMAGE, command.instead_of)
            case ReleaseFrames():
                self._pictures.release(_request(command.request_id))
            case RunMatch():
                for topic, frame in ((FISHEYE_IMAGE, command.frame), (PTZ_IMAGE, command.view.frame)):
                    self.require(topic, frame)
                    self._pictures.use(_match(command.match_id), topic, frame)
            case _:
                pass

    def picture(self, topic: str, picture: Picture) -> None:
        """A picture with the camera's own bytes; the same one again is ignored.

        Raises
        ------
        LogError
            No picture topic, or the writer has ended.
        """
        if topic not in self._counts:
            raise LogError(f"{topic}: no topic of pictures; there are {', '.join(IMAGES)}")
        if self._pictures.written(topic, picture.frame):
            return
        self._pictures.add(topic, picture)
        turn = self._counts[topic]
        self._counts[topic] += 1
        if self._pictures.wanted(topic, picture.frame):
            self._put_picture(topic, picture, droppable=False)
        elif topic == FISHEYE_IMAGE and turn % self._settings.fisheye_every_n:
            self._skipped += 1
        elif not self._put_picture(topic, picture, droppable=True):
            self._refused += 1

    def require(self, topic: str, frame: FrameRef) -> None:
        """Make sure that this picture is in the present file, even if it was skipped or comes later."""
        picture = self._pictures.want(topic, frame)
        if picture is not None:
            self._put_picture(topic, picture, droppable=False)

    def document(self, topic: str, t_ns: int, document: dict[str, object]) -> None:
        """A message of any other topic; members that are None are left out.

        Raises
        ------
        LogError
            The log has no such topic of documents, or the writer has ended.
        """
        if find_topic(topic).encoding != "json":
            raise LogError(f"{topic}: takes pictures, no documents")
        body = msgspec.json.encode({name: value for name, value in document.items() if value is not None})
        self._put(Record(topic=topic, log_ns=t_ns, publish_ns=t_ns, sequence=0, data=body))

    def rotate_due(self) -> bool:
        """Whether the pump should call :meth:`rotate` before the next event."""
        scribe, settings = self._scribe, self._settings
        if scribe.current is None or scribe.snapshots != self._snapshots:
            return False
        return scribe.headless or scribe.size >= settings.rotate_bytes or scribe.age_s >= settings.rotate_s

    def rotate(self, sequence: int, t_ns: int, snapshot: Snapshot) -> None:
        """Begin a file: what came before is in the old one, this snapshot and all that comes now in the new one.

        A file that holds no decision yet, as at the start, goes on. Errors as for :meth:`event`.
        """
        self._put(Cut())
        self.event(sequence, t_ns, snapshot)
        for topic, picture in self._pictures.begin_file():
            self._put_picture(topic, picture, droppable=False)

    def adopt(self, settings: LogSettings, run: RunInfo) -> None:
        """Take over other settings, but for directory and queue; what ``run`` says stands in files that begin later.

        Raises
        ------
        LogError
            The writer has ended.
        """
        self._settings = settings
        self._put(Adopt(settings, run))

    async def settled(self) -> None:
        """Wait until everything told so far is readable in a file, cuts included.

        Raises
        ------
        LogError
            The writer has ended.
        """
        loop = asyncio.get_running_loop()
        done = asyncio.Event()

        def tell() -> None:
            with contextlib.suppress(RuntimeError):  # nobody waits in a loop that has closed
                loop.call_soon_threadsafe(done.set)

        self._put(Settle(tell))
        while not done.is_set():
            if self._scribe.ended:
                raise self._ended()
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(done.wait(), PATIENCE_S)

    @property
    def current_file(self) -> Path | None:
        """Name that the file being written will have; None while the disk refuses."""
        return self._scribe.current

    def closed_files(self) -> list[Path]:
        """Whole files of this rig, oldest first."""
        return [stored.path for stored in retention.closed_files(self._directory, self._rig)]

    @property
    def beats(self) -> int:
        """Sign of life of the writer: changes every second, with a full disk and with nothing to write as well."""
        return self._scribe.beats

    def stats(self) -> LogStats:
        """How the log is doing."""
        counters = asdict(self._scribe.counters)
        counters["pictures_dropped"] += self._refused
        return LogStats(
            **counters,
            pictures_skipped=self._skipped,
            waiting=len(self._inbox),
            degraded="the writer has ended" if self._scribe.ended else self._scribe.degraded,
            notes=self._notes,
        )

    def _decision(self, topic: str, sequence: int, t_ns: int, name: str, body: bytes, source: Event | Command) -> None:
        document = {"sequence": sequence, "t_ns": t_ns, "name": name, "body": body.decode()}
        data = msgspec.json.encode(document)
        self._put(Record(topic=topic, log_ns=t_ns, publish_ns=t_ns, sequence=sequence, data=data, source=source))

    def _put_picture(self, topic: str, picture: Picture, *, droppable: bool) -> bool:
        t_ns = picture.frame.t_capture_ns
        image = CompressedImage(t_ns=t_ns, frame_id=FRAME_IDS[topic], data=picture.jpeg, format="jpeg")
        taken = self._put(
            Record(
                topic=topic,
                log_ns=picture.t_arrival_ns,
                publish_ns=t_ns,
                sequence=picture.frame.seq,
                data=image,
                droppable=droppable,
            )
        )
        if taken:
            self._pictures.wrote(topic, picture.frame)
        return taken

    def _ended(self) -> LogError:
        return LogError(f"{self._directory}: the log's writer has ended; the daemon must not go on without it")

    def _put(self, item: Item) -> bool:
        if self._closed or self._scribe.ended:
            raise self._ended()
        if (
            isinstance(item, Record)
            and not 0 <= min(item.log_ns, item.publish_ns) <= max(item.log_ns, item.publish_ns) < _MAX_NS
        ):
            raise LogError(f"{item.topic}: a time outside 0 to 2^63 ns: {item.log_ns}, {item.publish_ns}")
        return self._inbox.put(item)


def _request(name: str) -> str:
    """Owner of the frames that a request pinned."""
    return f"request {name}"


def _match(match_id: int) -> str:
    """Owner of the pictures that a match under way looks at."""
    return f"match {match_id}"
