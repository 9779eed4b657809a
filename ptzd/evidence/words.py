"""What became of a request, in sentences that need no knowledge of the program."""

from __future__ import annotations

from collections.abc import Iterator

from ptzd.control.wording import range_in_words
from ptzd.evidence.story import Story
from ptzd.geometry.rig import Rig
from ptzd.log.times import clock_time

ENDS = {
    "locked": "The target was found, confirmed in a picture of its own, centred and held as long as asked.",
    "released": "The target was found and held until it was released.",
    "not_found": "The region was not recognised in any picture, so the camera was pointed at nothing.",
    "ambiguous": "Several places looked alike, so the camera was pointed at none of them.",
    "no_texture": "The region has too little structure to be recognised.",
    "unreachable": "There is no position of the camera from which it could see the place.",
    "stale_frame": "The picture that the box was drawn on was no longer there.",
    "preempted": "Another request took its turn.",
    "cancelled": "It was taken back before it was done.",
    "timeout": "It took longer than it was allowed to.",
    "lost": "The target had been found and was not recognised any more.",
    "device_lost": "A device was lost while the request was served.",
    "shadow": "The daemon was a shadow: it says where the camera would have looked, and nothing moved.",
    "rejected": "It was refused.",
    "refused": "It was refused before anything moved.",
    "open": "This file ends before the request does.",
}


def sentences(story: Story, rig: Rig) -> Iterator[str]:
    """Asked, looked, found, ended; in this order, those that apply."""
    yield _asked(story)
    if story.looks:
        pictures = len({look.job.view.frame for look in story.looks})
        yield f"The camera took {_counted(pictures, 'picture')} of where it could be, and each was searched for it."
    result = story.result
    if result is not None and result.probability is not None:
        where = "" if result.pan_deg is None else f" at pan {result.pan_deg:.2f}°, tilt {result.tilt_deg:.2f}°"
        sigma = "" if result.sigma_deg is None else f" ± {result.sigma_deg:.3f}°"
        chance = f"{min(100 * result.probability, 99.99):.2f} %"
        yield f"It was recognised with {chance} certainty{where}{sigma}{_away(result.range_m, rig)}."
    yield ENDS.get(story.outcome, f"It ended as {story.outcome}.")
    if result is not None:
        yield f"That took {result.elapsed_ms / 1000:.1f} s."
    if story.reason:
        yield f"The reason as recorded: {story.reason}."


def _asked(story: Story) -> str:
    name = f"“{story.label or story.id}”"
    at = clock_time(story.t_ns)
    if story.request is None:
        return f"{name} was asked for before this file begins; it is first heard of at {at}."
    box = story.request.box
    return f"At {at} the {box.w:g} × {box.h:g} pixels at {box.x:g}, {box.y:g} of the fisheye were asked for: {name}."


def distance(range_m: float | None, rig: Rig) -> str:
    """A range with its unit, which is the baseline where the calibration is not metric."""
    if range_m is None:
        return "unknown or infinite"
    return range_in_words(range_m, metric=rig.metric)


def _away(range_m: float | None, rig: Rig) -> str:
    return "" if range_m is None else f", {distance(range_m, rig)} away"


def _counted(number: int, what: str) -> str:
    return f"one {what}" if number == 1 else f"{number} {what}s"
