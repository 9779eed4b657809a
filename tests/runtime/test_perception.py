from __future__ import annotations

import asyncio
import dataclasses
import threading

import cv2
import numpy as np
import pytest

from ptzd.control.commands import RunMatch
from ptzd.errors import MatchError, PtzdError
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


@pytest.mark.parametrize("where", ["match", "decode_grey"])
@pytest.mark.parametrize(
    "error",
    [
        cv2.error("OpenCV: (-215:Assertion failed)\n  dst.rows < SHRT_MAX"),
        np.linalg.LinAlgError("Singular matrix"),
        MemoryError("Unable to allocate 18.4 GiB"),
        ZeroDivisionError("division by zero"),
        IndexError("index 9 is out of bounds"),
    ],
)
async def test_whatever_arithmetic_stumbles_over_is_one_match_s_failure_in_a_line(
    rig, jpeg, monkeypatch, where: str, error: Exception
) -> None:
    def stumbles(*_: object) -> None:
        raise error

    async with ThreadPerception(rig) as perception:
        with monkeypatch.context() as broken:
            broken.setattr(room, where, stumbles)
            with pytest.raises(MatchError, match=type(error).__name__) as told:
                await perception.match(job(), jpeg(), jpeg())
        assert "\n" not in str(told.value)
        assert "test_perception.py:" in str(told.value)
        assert (await perception.match(job(), jpeg(), jpeg())).seed == 1


async def test_a_job_beyond_its_budget_is_refused_and_the_same_again_is_too(rig, jpeg) -> None:
    dear = dataclasses.replace(job(), band_rad=0.7, budget_s=0.001)
    async with ThreadPerception(rig) as perception:
        told = []
        for _ in range(2):
            with pytest.raises(MatchError) as error:
                perception.match_now(dear, jpeg(), jpeg())
            told.append(str(error.value))
    assert told[0] == told[1]
