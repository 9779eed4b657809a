"""A rig whose calibration has no scale, from the request to the exported tables: no range of it is called metres."""

from __future__ import annotations

import asyncio
import json
import re

import numpy as np
import pytest
import yaml

from ptzd.cli.parser import parser
from ptzd.control.wording import range_in_words
from ptzd.errors import RequestRefused

METRES = re.compile(r"range \S+ m\b|\d m away|(?<!\$\.)\brange\w*_m\b")
"""Ranges as metres; a request's own field, as refusals name it, is none."""


async def test_no_range_of_a_rig_without_scale_is_told_in_metres(make_site, capsys) -> None:
    site = await make_site()
    calibration = site.folder / "rig.yaml"
    document = yaml.safe_load(calibration.read_text())
    part = document["rig"]
    baseline_m = float(np.linalg.norm(part["translation_m"]))
    part["translation_m"], part["metric"] = [value / baseline_m for value in part["translation_m"]], False
    if "uncertainty" in document:
        document["uncertainty"]["translation_m"] /= baseline_m
    calibration.write_text(yaml.safe_dump(document))
    site.change(search={"range_m": [1.0 / baseline_m, 100.0 / baseline_m]})
    await site.start()
    with pytest.raises(RequestRefused, match=r"got 3 and 2 .*baselines"):
        await site.client.request(id="r", box=site.box, range_m=(3.0, 2.0))
    result = await site.lock("a")
    true_m = site.rig.scene.demo_boxes[0].truth.range_m
    assert result.range_m is None
    assert result.range_baselines * baseline_m == pytest.approx(true_m, rel=0.2)
    await site.end()
    site.serving = None
    log, out = next((site.folder / "log").glob("*.mcap")), site.folder / "out"
    for words in (["log", "info", log], ["replay", log], ["log", "export", log, "--out", out]):
        arguments = parser().parse_args([str(word) for word in words])
        assert await asyncio.to_thread(arguments.run, arguments) == 0
    told = [capsys.readouterr().out]
    told += [json.dumps(step.detail) for step in site.steps("a")]
    told += [path.read_text() for path in out.rglob("*.html")]
    assert [METRES.findall(text) for text in told] == [[]] * len(told)
    assert range_in_words(result.range_baselines, metric=False) in "".join(told)
