"""A log names the code that wrote it."""

from __future__ import annotations

import re

from ptzd.app.fingerprint import versions
from ptzd.commit import commit


def test_a_checkout_is_named_by_its_commit_with_or_without_tags():
    assert re.fullmatch(r"[0-9a-f]{12,40}(-dirty)?", commit())
    assert versions()["commit"] == commit()
