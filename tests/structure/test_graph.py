"""No arrow goes upwards, no rooms go round in a circle, and no file is longer than a person reads at once."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import ptzd
from tests.structure.graph import ROOT, arrows, circle, layers, upwards

LONGEST = 400


def test_the_rooms_import_downwards_only():
    found = arrows()
    assert len(found) > 50
    assert upwards(found, layers()) == []
    assert circle(found) == []


def test_an_arrow_upwards_and_a_circle_are_seen():
    found = Counter({("a", "b"): 1, ("b", "a"): 2})
    assert upwards(found, [["a"], ["b"]]) == [("b", "a")]
    assert set(circle(found)) == {"a", "b"}


def test_no_file_is_longer_than_four_hundred_lines():
    written = [path for folder in ("ptzd", "tests", "scenes") for path in (ROOT / folder).rglob("*.py")]
    assert len(written) > 300
    long = {str(path): lines for path in written if (lines := len(path.read_text().splitlines())) > LONGEST}
    assert long == {}


def test_the_machine_only_hands_on() -> None:
    """What there is to know of events lies with those who answer to them."""
    assert len((Path(ptzd.__file__).parent / "control" / "machine.py").read_text().splitlines()) <= 150
