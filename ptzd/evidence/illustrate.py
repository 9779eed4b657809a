"""Turns decisions into what viewers show: tables, annotations, frames, scene, messages."""

from __future__ import annotations

import math
from collections import OrderedDict
from collections.abc import Iterable
from functools import singledispatchmethod
from typing import TypeVar

from ptzd.control import commands as cmd
from ptzd.control import events as ev
from ptzd.control.wording import scaled
from ptzd.evidence import arcs, foxglove, scene, tables
from ptzd.evidence.foxglove import CYAN, GREEN, RED, YELLOW, Line, Rgba
from ptzd.geometry.arc import EpipolarArc
from ptzd.geometry.rig import Rig
from ptzd.geometry.sphere import bearing
from ptzd.log.notes import Json, Level, log_message
from ptzd.log.scribe import Document
from ptzd.model import Box, Candidate, HeadReading, MatchResult, Outcome

REMEMBERED = 64
"""Requests and matches that are remembered; more are never under way at once."""
NAME = "ptzd"
_FAILED = frozenset({Outcome.DEVICE_LOST, Outcome.LOST, Outcome.TIMEOUT, Outcome.REJECTED})
Told = ev.Event | cmd.Command
_K = TypeVar("_K")
_V = TypeVar("_V")


class Illustrator:
    """Used by one thread, in the order in which decisions were taken.

    Parameters
    ----------
    rig : Rig
        Calibration that the decisions were taken with.
    """

    def __init__(self, rig: Rig) -> None:
        self._rig = rig
        self._boxes: OrderedDict[str, tuple[Box, str]] = OrderedDict()
        self._jobs: OrderedDict[int, cmd.RunMatch] = OrderedDict()
        self._drawn: tuple[str, int] | None = None
        self._pose: HeadReading | None = None

    def documents(self, t_ns: int, told: Told) -> Iterable[Document]:
        """Documents for one event or command.

        Parameters
        ----------
        t_ns : int
            When it was decided, ns since the epoch.
        told : Event or Command
            What was decided.
        """
        return list(self._draw(told, t_ns))

    @singledispatchmethod
    def _draw(self, told: Told, t_ns: int) -> Iterable[Document]:
        """Of most there is nothing to show."""
        return ()

    @_draw.register
    def _snapshot(self, told: ev.Snapshot, t_ns: int) -> Iterable[Document]:
        """Every file begins with what does not change."""
        self._drawn = self._pose = None
        yield _at("/tf", t_ns, scene.fixed_transforms(t_ns, self._rig))
        yield _at("/scene", t_ns, scene.rig_scene(t_ns, self._rig))
        fisheye = scene.calibration(t_ns, "fisheye", self._rig.fisheye)
        if fisheye is not None:
            yield _at("/fisheye/calibration", t_ns, fisheye)

    @_draw.register
    def _status(self, told: cmd.PublishStatus, t_ns: int) -> Iterable[Document]:
        yield _at("/state", t_ns, tables.state_document(told))

    @_draw.register
    def _request(self, told: ev.RequestReceived, t_ns: int) -> Iterable[Document]:
        _remember(self._boxes, told.id, (told.box, told.label))
        yield _at("/request", t_ns, scaled(tables.request_document(told), metric=self._rig.metric))
        box = told.box
        yield _say(t_ns, f"{told.id}: look at {box.w:g} x {box.h:g} px at {box.x:g}, {box.y:g} {told.label}".rstrip())

    @_draw.register
    def _update(self, told: ev.UpdateReceived, t_ns: int) -> Iterable[Document]:
        label = self._boxes[told.id][1] if told.id in self._boxes else ""
        _remember(self._boxes, told.id, (told.box, label))
        return ()

    @_draw.register
    def _pin(self, told: cmd.PinFrame, t_ns: int) -> Iterable[Document]:
        """The box at once, on the very frame that it was drawn on."""
        if told.request_id in self._boxes:
            box, label = self._boxes[told.request_id]
            yield self._fisheye(told.frame.t_capture_ns, box, label or told.request_id, None)

    @_draw.register
    def _job(self, told: cmd.RunMatch, t_ns: int) -> Iterable[Document]:
        _remember(self._jobs, told.match_id, told)
        key = (told.request_id, told.frame.t_capture_ns)
        if key == self._drawn:
            return
        arc = arcs.arc_of(self._rig, told)
        label = self._boxes[told.request_id][1] if told.request_id in self._boxes else ""
        yield self._fisheye(told.frame.t_capture_ns, told.box, label or told.request_id, arc)
        if arc is not None:
            yield _at("/scene", t_ns, scene.arc_scene(t_ns, self._rig, arc))
        self._drawn = key

    @_draw.register
    def _matched(self, told: ev.MatchFinished, t_ns: int) -> Iterable[Document]:
        job = self._jobs.pop(told.match_id, None)
        yield _at("/match", t_ns, scaled(tables.match_document(told, job), metric=self._rig.metric))
        if job is None:
            return
        arc = arcs.arc_of(self._rig, job)
        yield self._view(job, told.result, arc)
        if told.result.candidates and arc is not None:
            best = told.result.candidates[0]
            far = scene.target_distance(arc, best.inverse_range)
            text = f"{job.request_id} {best.score:.2f}"
            yield _at("/scene", t_ns, scene.target_scene(t_ns, bearing(best.pan_rad, best.tilt_rad), far, text))

    @_draw.register
    def _unmatched(self, told: ev.MatchFailed, t_ns: int) -> Iterable[Document]:
        yield _at("/match", t_ns, tables.match_document(told, self._jobs.pop(told.match_id, None)))
        yield _say(t_ns, f"match {told.match_id}: {told.reason}", Level.WARNING)

    @_draw.register
    def _result(self, told: cmd.PublishResult, t_ns: int) -> Iterable[Document]:
        level = Level.WARNING if told.outcome in _FAILED else Level.INFO
        yield _at("/result", t_ns, scaled(tables.result_document(told), metric=self._rig.metric))
        yield _say(t_ns, f"{told.id}: {told.outcome} after {told.elapsed_ms / 1000:.1f} s: {told.reason}", level)

    @_draw.register
    def _release(self, told: cmd.ReleaseFrames, t_ns: int) -> Iterable[Document]:
        """The request is over: what was drawn for it goes."""
        self._boxes.pop(told.request_id, None)
        self._drawn = None
        for topic in ("/fisheye/annotations", "/ptz/annotations"):
            yield _at(topic, t_ns, foxglove.annotations(t_ns))

    @_draw.register
    def _posed(self, told: ev.HeadPolled | ev.HeadReady | ev.HeadArrived, t_ns: int) -> Iterable[Document]:
        if told.reading == self._pose:
            return
        low, high = self._rig.zoom.zoom_range
        zoomed = self._pose is None or self._pose.zoom != told.reading.zoom
        self._pose = told.reading
        yield _at("/tf", t_ns, scene.camera_transform(t_ns, self._rig, told.reading))
        if zoomed and low <= told.reading.zoom <= high:
            document = scene.calibration(t_ns, "camera", self._rig.camera(told.reading))
            assert document is not None
            yield _at("/ptz/calibration", t_ns, document)

    @_draw.register
    def _lost(self, told: ev.DeviceLost, t_ns: int) -> Iterable[Document]:
        yield _say(t_ns, f"{told.device} lost: {told.reason}", Level.ERROR)

    @_draw.register
    def _well(self, told: ev.DeviceWell, t_ns: int) -> Iterable[Document]:
        yield _say(t_ns, f"{told.device} is well")

    @_draw.register
    def _garbled(self, told: ev.PayloadRefused, t_ns: int) -> Iterable[Document]:
        yield _say(t_ns, f"refused: {told.field}: {told.message}", Level.WARNING)

    @_draw.register
    def _refused(self, told: cmd.ReplyRefused, t_ns: int) -> Iterable[Document]:
        yield _say(t_ns, f"refused ({told.code}): {told.field}: {told.message}", Level.WARNING)

    @_draw.register
    def _note(self, told: cmd.PublishFeedback, t_ns: int) -> Iterable[Document]:
        detail = ", ".join(f"{name} {value}" for name, value in scaled(told.detail, metric=self._rig.metric).items())
        yield _say(t_ns, f"{told.id}: {told.step} {detail}".rstrip(), Level.DEBUG)

    def _fisheye(self, t_ns: int, box: Box, text: str, arc: EpipolarArc | None) -> Document:
        """Box, arc and epipole, with the time of the picture that they belong to."""
        lines = [foxglove.lines(t_ns, box.corners, Line.LOOP, GREEN)]
        lines += [
            foxglove.lines(t_ns, line, Line.STRIP, YELLOW, 1.5)
            for line in ([] if arc is None else arcs.in_fisheye(self._rig, arc))
        ]
        texts = [foxglove.label(t_ns, (box.x, box.y - 2.0), text, GREEN)]
        circles = []
        epipole = arcs.epipole_in_fisheye(self._rig)
        if epipole is not None:
            circles = [foxglove.circle(t_ns, epipole, 10.0, CYAN)]
            texts.append(foxglove.label(t_ns, (epipole[0] + 7.0, epipole[1]), "epipole", CYAN, 11.0))
        return _at("/fisheye/annotations", t_ns, foxglove.annotations(t_ns, lines, circles, texts))

    def _view(self, job: cmd.RunMatch, result: MatchResult, arc: EpipolarArc | None) -> Document:
        """Found boxes with their scores, the arc, with the time of the view."""
        t_ns = job.view.frame.t_capture_ns
        lines: list[Json] = []
        texts: list[Json] = []
        for rank, candidate in enumerate(result.candidates):
            shown = GREEN if rank == 0 else RED
            lines.append(foxglove.lines(t_ns, candidate.box_px, Line.LOOP, shown, 2.5 if rank == 0 else 1.0))
            texts.append(_score(t_ns, candidate, shown))
        if arc is not None:
            found = arcs.in_view(self._rig, arc, job.view.reading)
            lines += [foxglove.lines(t_ns, line, Line.STRIP, YELLOW, 1.0) for line in found]
        return _at("/ptz/annotations", t_ns, foxglove.annotations(t_ns, lines, (), texts))


def _score(t_ns: int, candidate: Candidate, rgba: Rgba) -> Json:
    left = min((x for x, _ in candidate.box_px), default=0.0)
    top = min((y for _, y in candidate.box_px), default=0.0)
    across = math.degrees(candidate.offset_rad)
    return foxglove.label(t_ns, (left, top - 2.0), f"{candidate.score:.2f} ({across:+.2f}° across)", rgba)


def _at(topic: str, t_ns: int, body: Json) -> Document:
    return Document(topic=topic, publish_ns=t_ns, body=body)


def _say(t_ns: int, text: str, level: Level = Level.INFO) -> Document:
    return _at("/log", t_ns, log_message(t_ns, level, NAME, text))


def _remember(known: OrderedDict[_K, _V], key: _K, value: _V) -> None:
    known[key] = value
    while len(known) > REMEMBERED:
        known.popitem(last=False)
