"""Runs matchers over cases in a few processes; the peers' answers are kept as long as their pictures stay the same."""

from __future__ import annotations

import hashlib
import json
import multiprocessing
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import cv2
import numpy as np

from ptzd.geometry.sphere import angle_between
from ptzd.model import Matcher
from tests.bench import own, peers
from tests.bench.cases import Case, Condition, cases
from tests.bench.conditions import CONDITIONS, PEERS_EVERY
from tests.bench.real import REAL, real_cases
from tests.bench.stage import RENDERED, rendered

Record = dict[str, object]
KEPT = Path("build/bench/peers.json")
MADE_FROM = ("cases.py", "conditions.py", "peers.py", "real.py", "spoil.py", "stage.py")
CONFIDENT_WRONG_DEG = 3.0

RUNNERS = {str(matcher): partial(own.run, matcher) for matcher in Matcher} | peers.PEERS


@dataclass(frozen=True, kw_only=True)
class Job:
    """What one process does."""

    scenes: tuple[str, ...]
    conditions: tuple[str, ...]
    matchers: tuple[str, ...]
    share: tuple[int, int]
    """This process's part k of n."""
    every: int = 1
    """Only every n-th region."""


def run(job: Job) -> list[Record]:
    """Answer every case of a share."""
    cv2.setNumThreads(1)
    records = []
    for scene in job.scenes:
        for condition in CONDITIONS:
            if condition.name in job.conditions:
                records += [
                    record for case in share_of(scene, condition, job) for record in answers(case, condition, job)
                ]
                print(f"{job.share[0]}: {scene}, {condition.name}", file=sys.stderr, flush=True)
    return records


def share_of(scene: str, condition: Condition, job: Job) -> Iterator[Case]:
    if scene not in REAL:
        return cases(scene, condition, job.share, job.every)
    wanted = condition.name == "clean" and job.share[0] == 0
    return iter(real_cases(scene) if wanted else ())


def answers(case: Case, condition: Condition, job: Job) -> Iterator[Record]:
    for name in job.matchers:
        if name in peers.PEERS and not (condition.peers and (case.index % PEERS_EVERY == 0 or case.scene in REAL)):
            continue
        yield record(case, name, RUNNERS[name](case))


def record(case: Case, matcher: str, answer: Record) -> Record:
    """What was answered, and how far off that is."""
    direction = answer.pop("direction")
    error = None
    if direction is not None and len(case.truths):
        error = float(np.degrees(min(angle_between(direction, truth) for truth in case.truths)))
    present = bool(len(case.truths)) and case.visible
    lost = error is None or error > CONFIDENT_WRONG_DEG
    return {
        "scene": case.scene,
        "region": case.name,
        "kind": case.kind,
        "condition": case.condition,
        "matcher": matcher,
        "present": present,
        "edge": len(case.truths) > 1,
        "views": len(case.views),
        "error_deg": error,
        "wrong": bool(answer["found"]) and lost,
    } | answer


def run_all(
    scenes: Sequence[str], conditions: Sequence[str], matchers: Sequence[str], every: int, processes: int
) -> list[Record]:
    """Answer every case, in some processes; the order of the records is that of one process."""
    for scene in scenes:
        if scene in RENDERED:
            rendered(scene)
    jobs = [
        Job(
            scenes=tuple(scenes),
            conditions=tuple(conditions),
            matchers=tuple(matchers),
            share=(k, processes),
            every=every,
        )
        for k in range(processes)
    ]
    with multiprocessing.get_context("spawn").Pool(processes) as pool:
        return [record for part in pool.map(run, jobs, chunksize=1) for record in part]


def with_kept_peers(
    scenes: Sequence[str], conditions: Sequence[str], matchers: Sequence[str], every: int, processes: int
) -> list[Record]:
    """Like `run_all`, but with the peers' answers of an earlier run on the very same cases."""
    asked = [name for name in matchers if name in peers.PEERS]
    mine = [name for name in matchers if name not in peers.PEERS]
    wanted = [condition.name for condition in CONDITIONS if condition.peers and condition.name in conditions]
    made_from = _made_from(scenes, [list(scenes), wanted, asked, every])
    kept = json.loads(KEPT.read_text()) if KEPT.is_file() else {"made_from": ""}
    if asked and kept["made_from"] != made_from:
        kept = {"made_from": made_from, "records": run_all(scenes, wanted, asked, every, processes)}
        KEPT.parent.mkdir(parents=True, exist_ok=True)
        KEPT.write_text(json.dumps(kept))
    own_records = run_all(scenes, conditions, mine, every, processes) if mine else []
    return own_records + (kept["records"] if asked else [])


def _made_from(scenes: Sequence[str], asked: object) -> str:
    """Digest of what the peers' answers depend on."""
    key = hashlib.sha256(json.dumps(asked).encode())
    for name in MADE_FROM:
        key.update((Path(__file__).parent / name).read_bytes())
    for scene in scenes:
        if scene in RENDERED:
            key.update((rendered(scene) / "boxes.sha256").read_bytes())
    return key.hexdigest()
