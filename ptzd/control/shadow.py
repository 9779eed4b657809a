"""Shadow: what is decided moves nothing; what only a picture can tell stays open, and what would have been is told."""

from __future__ import annotations

from ptzd.control.requests import Missed, Task
from ptzd.control.work import Work
from ptzd.model import Outcome

SEEN = frozenset({Outcome.NOT_FOUND, Outcome.AMBIGUOUS, Outcome.UNREACHABLE, Outcome.LOST})
"""Ends that rest on what the pictures show: without the pictures they are nobody's to tell."""

NOT_TOLD = "the daemon is a shadow and moves nothing, so the camera was not told to stop; whoever moves it must stop it"
"""A stop that ends all requests and reaches no camera: nobody may take it for one that did."""


def note_missed(work: Work, task: Task) -> None:
    """A picture would have been taken now, where the shadow's head stands."""
    reading = work.head.reading
    if reading is None:
        raise AssertionError("a look of a head whose place is not known")
    missed = Missed(reading=reading, after_ns=work.t_ns - task.request.accepted_ns)
    task.missed.append(missed)
    work.feedback(
        task.request.id,
        "shadow",
        pan_deg=reading.pan_deg,
        tilt_deg=reading.tilt_deg,
        zoom=reading.zoom,
        after_s=round(missed.after_ns / 1e9, 3),
    )


def as_shadow(task: Task, outcome: Outcome, reason: str) -> tuple[Outcome, str]:
    """The end of a request as a shadow may tell it: as it is where no look was missed, or where none mattered."""
    if not task.missed or outcome not in SEEN:
        return outcome, reason
    looks = "; ".join(_in_words(missed) for missed in task.missed)
    count = "one look" if len(task.missed) == 1 else f"{len(task.missed)} looks"
    told = f"nothing moves in shadow mode; would have taken {count}: {looks}; the rest is up to what they show"
    return Outcome.SHADOW, told


def _in_words(missed: Missed) -> str:
    pose, after_s = missed.reading, missed.after_ns / 1e9
    return f"pan {pose.pan_deg:.2f}°, tilt {pose.tilt_deg:.2f}°, zoom {pose.zoom:.0f} after {after_s:.1f} s"
