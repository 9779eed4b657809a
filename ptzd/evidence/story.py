"""Requests as a log tells them: who asked for what, what was seen and decided, how it ended."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

from ptzd.control import commands as cmd
from ptzd.control import events as ev
from ptzd.control.wording import in_words, scaled
from ptzd.log.reader import LoggedCommand, LoggedEvent
from ptzd.model import Box, FrameRef


@dataclass(frozen=True, slots=True, kw_only=True)
class Step:
    """One line of a request's timeline."""

    t_ns: int
    sequence: int
    what: str
    """state, view, match, correction … as in the feedback; request, update, result."""
    text: str


@dataclass(slots=True, kw_only=True)
class Look:
    """One view, and what the matcher said of it."""

    t_ns: int
    job: cmd.RunMatch
    answer: ev.MatchFinished | ev.MatchFailed | None = None


@dataclass(slots=True, kw_only=True)
class Story:
    """One request."""

    id: str
    t_ns: int
    """When it was first heard of in this log."""
    request: ev.RequestReceived | None = None
    """None when it came in before this file."""
    frame: FrameRef | None = None
    steps: list[Step] = field(default_factory=list)
    looks: list[Look] = field(default_factory=list)
    result: cmd.PublishResult | None = None
    refusal: cmd.ReplyRefused | None = None

    @property
    def box(self) -> Box | None:
        """Box as asked for, or as last searched for."""
        if self.request is not None:
            return self.request.box
        return self.looks[-1].job.box if self.looks else None

    @property
    def label(self) -> str:
        """Free text of the client."""
        if self.result is not None:
            return self.result.label
        return self.request.label if self.request is not None else ""

    @property
    def outcome(self) -> str:
        """How it ended; ``refused`` before it began, ``open`` when this log does not say."""
        if self.result is not None:
            return self.result.outcome.value
        return "refused" if self.refusal is not None else "open"

    @property
    def reason(self) -> str:
        """One sentence."""
        if self.result is not None:
            return self.result.reason
        return self.refusal.message if self.refusal is not None else ""

    @property
    def found(self) -> Look | None:
        """The look with the best score."""
        scored = [
            (look.answer.result.candidates[0].score, index)
            for index, look in enumerate(self.looks)
            if isinstance(look.answer, ev.MatchFinished) and look.answer.result.candidates
        ]
        return self.looks[max(scored)[1]] if scored else None


class Stories:
    """Collects requests from decisions in write order.

    Parameters
    ----------
    metric : bool
        Whether the rig's ranges are in m, for the steps' texts; if not, in baselines.
    """

    def __init__(self, *, metric: bool) -> None:
        self.metric = metric
        self.all: list[Story] = []
        self._open: dict[str, Story] = {}
        self._tokens: dict[int, Story] = {}
        self._looks: dict[int, Look] = {}

    def tell(self, decision: LoggedEvent | LoggedCommand) -> None:
        """Take the next decision in."""
        if isinstance(decision, LoggedEvent):
            self._event(decision.sequence, decision.t_ns, decision.event)
        else:
            self._command(decision.sequence, decision.t_ns, decision.command)

    def _story(self, name: str, t_ns: int) -> Story:
        story = self._open.get(name)
        if story is None:
            story = Story(id=name, t_ns=t_ns)
            self._open[name] = story
            self.all.append(story)
        return story

    def _event(self, sequence: int, t_ns: int, event: ev.Event) -> None:
        match event:
            case ev.RequestReceived():
                self._request(sequence, t_ns, event)
            case ev.UpdateReceived() if event.id in self._open:
                text = f"box now {_box(event.box)}"
                self._open[event.id].steps.append(Step(t_ns=t_ns, sequence=sequence, what="update", text=text))
            case ev.CancelReceived() if event.id in self._open:
                self._open[event.id].steps.append(
                    Step(t_ns=t_ns, sequence=sequence, what="cancel", text="the client asked to cancel")
                )
            case ev.MatchFinished() | ev.MatchFailed() if event.match_id in self._looks:
                self._looks.pop(event.match_id).answer = event
            case _:
                pass

    def _request(self, sequence: int, t_ns: int, event: ev.RequestReceived) -> None:
        story = self._open.get(event.id)
        if story is None or story.result is not None or story.refusal is not None:
            self._open.pop(event.id, None)
            story = self._story(event.id, t_ns)
            story.request = event
        if event.token is not None:
            self._tokens[event.token] = story
        story.steps.append(Step(t_ns=t_ns, sequence=sequence, what="request", text=f"box {_box(event.box)}"))

    def _command(self, sequence: int, t_ns: int, command: cmd.Command) -> None:
        match command:
            case cmd.PinFrame():
                self._story(command.request_id, t_ns).frame = command.frame
            case cmd.ReplyRefused() if command.token in self._tokens:
                story = self._tokens.pop(command.token)
                story.refusal = command
                story.steps.append(Step(t_ns=t_ns, sequence=sequence, what="refused", text=command.message))
            case cmd.RunMatch():
                look = Look(t_ns=t_ns, job=command)
                self._story(command.request_id, t_ns).looks.append(look)
                self._looks[command.match_id] = look
            case cmd.PublishFeedback():
                text = in_words(scaled(command.detail, metric=self.metric))
                step = Step(t_ns=t_ns, sequence=sequence, what=command.step, text=text)
                self._story(command.id, t_ns).steps.append(step)
            case cmd.PublishResult():
                story = self._story(command.id, t_ns)
                story.result = command
                text = f"{command.outcome}: {command.reason}"
                story.steps.append(Step(t_ns=t_ns, sequence=sequence, what="result", text=text))
            case _:
                pass


def collect(decisions: Iterable[LoggedEvent | LoggedCommand], *, metric: bool = True) -> list[Story]:
    """Requests in the order in which they came in."""
    stories = Stories(metric=metric)
    for decision in decisions:
        stories.tell(decision)
    return stories.all


def _box(box: Box) -> str:
    return f"{box.w:g} x {box.h:g} px at {box.x:g}, {box.y:g}"
