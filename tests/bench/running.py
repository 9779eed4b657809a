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
from tests.bench.conditions import CONDITIONS, OTHERS_EVERY
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
    every: int
    """Only every n-th region."""
    share: tuple[int, int]
    """This process's part k of n."""

    def mine(self, index: int, every: int) -> bool:
        """Whether a region is asked for, by this process; the condition wants every so many."""
        k, n = self.share
        step = max(self.every, every if str(Matcher.SWEEP) in self.matchers else OTHERS_EVERY)
        return index % step == 0 and index // max(step, OTHERS_EVERY) % n == k


def run(job: Job, out: Path) -> None:
    """Answer every case of a share; each answer is a line of the file as soon as it is there."""
    cv2.setNumThreads(1)
    with out.open("w") as file:
        for condition in CONDITIONS:
            for scene in job.scenes if condition.name in job.conditions else ():
                for case in cases_of(scene, condition, job):
                    file.writelines(json.dumps(answer) + "\n" for answer in answers(case, condition, job))
                file.flush()
            print(f"{job.share[0]}: {condition.name}", file=sys.stderr, flush=True)


def cases_of(scene: str, condition: Condition, job: Job) -> Iterator[Case]:
    if scene not in REAL:
        return cases(scene, condition, lambda index: job.mine(index, condition.every))
    return (case for case in real_cases(scene) if condition.name == "clean" and job.mine(case.index, 1))


def answers(case: Case, condition: Condition, job: Job) -> Iterator[Record]:
    for name in job.matchers:
        if name == str(Matcher.SWEEP) or (condition.others and case.index % OTHERS_EVERY == 0):
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
    """Answer every case, in some processes."""
    for scene in scenes:
        if scene in RENDERED:
            rendered(scene)
    KEPT.parent.mkdir(parents=True, exist_ok=True)
    context = multiprocessing.get_context("spawn")
    files = [KEPT.parent / f"{'-'.join(matchers)}-{k}.jsonl" for k in range(processes)]
    workers = []
    for k, file in enumerate(files):
        job = Job(
            scenes=tuple(scenes),
            conditions=tuple(conditions),
            matchers=tuple(matchers),
            every=every,
            share=(k, processes),
        )
        workers.append(context.Process(target=run, args=(job, file)))
        workers[-1].start()
    for worker in workers:
        worker.join()
        if worker.exitcode != 0:
            raise SystemExit(f"a process of the bench ended with {worker.exitcode}")
    return [json.loads(line) for file in files for line in file.read_text().splitlines()]


def with_kept_peers(
    scenes: Sequence[str], conditions: Sequence[str], matchers: Sequence[str], every: int, processes: int
) -> list[Record]:
    """Like `run_all`, but with the peers' answers of an earlier run on the very same cases."""
    asked = [name for name in matchers if name in peers.PEERS]
    mine = [name for name in matchers if name not in peers.PEERS]
    wanted = [condition.name for condition in CONDITIONS if condition.others and condition.name in conditions]
    made_from = _made_from(scenes, [list(scenes), wanted, asked, every])
    kept = json.loads(KEPT.read_text()) if KEPT.is_file() else {"made_from": ""}
    if asked and kept["made_from"] != made_from:
        kept = {"made_from": made_from, "records": run_all(scenes, wanted, asked, every, processes)}
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
