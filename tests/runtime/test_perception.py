from __future__ import annotations

import asyncio
import threading

import pytest

from ptzd.control.commands import RunMatch
from ptzd.errors import PtzdError
from ptzd.model import Box, FrameRef, HeadReading, Matcher, ViewRef
from ptzd.runtime import perception as room
from ptzd.runtime.perception import ThreadPerception

FRAME = FrameRef(seq=1, t_capture_ns=1)


def job() -> RunMatch:
    view = ViewRef(frame=FRAME, reading=HeadReading(pan_deg=0.0, tilt_deg=0.0, zoom=1.0), sigma_deg=0.01)
    return RunMatch(
        match_id=1, request_id="a", frame=FRAME, box=Box(x=300, y=220, w=40, h=40), view=view,
        inverse_range=(0.1, 0.5), band_rad=0.01, matcher=Matcher.SWEEP, seed=1,
    )  # fmt: skip


async def test_a_match_runs_in_a_thread_of_its_own_and_the_same_again_is_the_same(rig, jpeg, monkeypatch) -> None:
    threads: list[str] = []
    match = room.match

    def noted(inputs, matcher):
        threads.append(threading.current_thread().name)
        return match(inputs, matcher)

    monkeypatch.setattr(room, "match", noted)
    async with ThreadPerception(rig) as perception:
        one, two = await asyncio.gather(*(perception.match(job(), jpeg(), jpeg()) for _ in range(2)))
        now = perception.match_now(job(), jpeg(), jpeg())
    assert one.candidates == two.candidates == now.candidates
    assert one.texture == now.texture
    assert len(set(threads[:2])) == 1
    assert threads[0].startswith("perception")
    assert threads[2] == threading.main_thread().name


@pytest.mark.parametrize("wrong", [b"", b"\xff\xd8\xff\xd9", b"<html>"])
async def test_a_picture_that_does_not_decode_is_a_named_error(rig, jpeg, wrong: bytes) -> None:
    async with ThreadPerception(rig) as perception:
        with pytest.raises(PtzdError):
            await perception.match(job(), wrong, jpeg())
        with pytest.raises(PtzdError):
            await perception.match(job(), jpeg(), wrong)
        assert (await perception.match(job(), jpeg(), jpeg())).seed == 1
