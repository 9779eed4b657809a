"""A request in sentences, and the page that shows them."""

import dataclasses

import pytest

from ptzd.evidence import page
from ptzd.evidence.story import Step, Story, collect
from ptzd.evidence.words import ENDS, distance, sentences
from ptzd.log.reader import LogReader
from ptzd.model import Outcome


@pytest.fixture
def story(lock_log):
    with LogReader(lock_log) as log:
        return collect(log.decisions())[0]


def test_every_end_has_its_sentence():
    assert set(ENDS) == {str(outcome) for outcome in Outcome} | {"refused", "open"}


def test_what_happened_is_told_in_order(rig, story, lock):
    said = list(sentences(story, rig))
    assert said[0].endswith("the 44 × 36 pixels at 350, 215 of the fisheye were asked for: “=gate <b>”.")
    assert said[1] == "The camera took one picture of where it could be, and each was searched for it."
    assert said[2] == f"It was recognised with 99.00 % certainty at pan 1.50°, tilt 2.50°, {lock.range_m:.2f} m away."
    assert said[3:] == [ENDS["locked"], "That took 1.4 s.", "The reason as recorded: held as asked."]


def test_what_is_not_known_is_not_told(rig):
    (first, last) = sentences(Story(id="x", t_ns=0), rig)
    assert "before this file begins" in first
    assert last == ENDS["open"]
    assert distance(None, rig) == "unknown or infinite"
    assert distance(2.0, dataclasses.replace(rig, metric=False)) == "2.00 baselines"


def test_the_lock_stands_beside_the_region(lock_log, rig, story):
    with LogReader(lock_log) as log:
        assert "the lock, after" not in page.render(log, rig, story)
        story.steps.append(Step(t_ns=story.t_ns, sequence=7, what="locked", text=""))
        text = page.render(log, rig, story)
    assert text.index("the region that was asked for") < text.index("the lock, after") < text.index("fisheye frame 11")
    assert "The lock is shown above." in text
    assert "ptzd replay --recompute lock.mcap" in text
    assert "best score 0.970" in text
