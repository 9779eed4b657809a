from __future__ import annotations

import cv2
import msgspec
import numpy as np
import pytest

from ptzd.control import commands as cmd
from ptzd.control import events as ev
from ptzd.model import Box, Candidate, FrameRef, HeadReading, Matcher, MatchResult, ViewRef
from ptzd.runtime.frames import FrameStore
from ptzd.runtime.overlays import Overlays, draw_candidate

CORNERS = ((100.0, 100.0), (300.0, 100.0), (300.0, 250.0), (100.0, 250.0))


def candidate() -> Candidate:
    return Candidate(
        pan_rad=0.0, tilt_rad=0.0, inverse_range=0.2, offset_rad=0.0, score=0.9, sharpness=0.1, sigma_rad=1e-4,
        plane=(0.0, 0.0, 0.2), box_px=CORNERS,
    )  # fmt: skip


def run_match(view: FrameRef) -> cmd.RunMatch:
    seen = ViewRef(frame=view, reading=HeadReading(pan_deg=0, tilt_deg=0, zoom=7.0), sigma_deg=0.01)
    return cmd.RunMatch(
        match_id=3, request_id="a", frame=view, box=Box(x=1, y=1, w=20, h=20), view=seen, inverse_range=(0.0, 1.0),
        band_rad=0.01, matcher=Matcher.SWEEP, seed=1,
    )  # fmt: skip


def finished(*candidates: Candidate) -> ev.MatchFinished:
    result = MatchResult(
        matcher=Matcher.SWEEP, texture=5.0, candidates=candidates, coverage=(0.0, 1.0), seed=1, elapsed_ms=1.0
    )
    return ev.MatchFinished(match_id=3, result=result)


def test_the_box_is_drawn_where_it_was_found(jpeg) -> None:
    before = cv2.imdecode(np.frombuffer(jpeg(), np.uint8), cv2.IMREAD_COLOR)
    after = cv2.imdecode(np.frombuffer(draw_candidate(jpeg(), candidate()), np.uint8), cv2.IMREAD_COLOR)
    assert after.shape == before.shape
    b, g, r = after[175, 300].astype(int)
    assert g > b + 50
    assert g > r + 50


@pytest.mark.parametrize(
    ("wanted", "found", "kept"), [(True, True, True), (False, True, True), (True, False, True), (True, True, False)]
)
async def test_an_overlay_is_offered_when_somebody_looks_and_something_was_found(
    rig, bus, picture, wanted: bool, found: bool, kept: bool
) -> None:
    frames, view = FrameStore(4), picture(2)
    if kept:
        frames.add_view(view)
    bus.wanted = {"image/overlay"} if wanted else set()
    overlays = Overlays(rig=rig, bus=bus, frames=frames)
    overlays.seen(1, ev.HeadStopped(), [run_match(view.frame)])
    overlays.seen(2, finished(*([candidate()] if found else [])), [])
    await overlays.close()
    assert len(bus.images) == (wanted and found and kept)
    for key, _, attachment in bus.images:
        assert key == "image/overlay"
        assert attachment.seq == 2
        assert attachment.zoom == 7.0
        assert None not in msgspec.structs.asdict(attachment).values(), "whoever draws over it knows all of it"


async def test_an_answer_nobody_asked_for_is_not_drawn(rig, bus) -> None:
    bus.wanted = {"image/overlay"}
    overlays = Overlays(rig=rig, bus=bus, frames=FrameStore(4))
    overlays.seen(2, finished(candidate()), [])
    await overlays.close()
    assert bus.images == []
