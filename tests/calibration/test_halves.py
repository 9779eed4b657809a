"""What a rig from a scene expects of its own pointing follows the noise, and what is above the limit is refused."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from ptzd.calibrate.rig import judge
from ptzd.calibration.halves import PointingError, pointing_error
from ptzd.calibration.planes import refine_by_planes
from ptzd.calibration.scene_rig import ScenePairs, calibrate_scene_rig
from ptzd.errors import CalibrationError
from tests.calibration.test_planes import SIZE, pointing_deg, room


def expected(noise_px: float) -> tuple[PointingError, float]:
    """What is expected, and the true error at 95 %, rad."""
    pairs: ScenePairs = room(5, count=900, noise_px=noise_px)[0]
    fit = refine_by_planes(calibrate_scene_rig(pairs, SIZE), SIZE, held=False)
    told = pointing_error(fit, SIZE, held=False)
    return told, math.radians(float(np.percentile(pointing_deg(fit), 95)))


def test_the_expected_error_follows_the_noise_and_covers_the_true_one() -> None:
    (quiet, true_quiet), (loud, true_loud) = expected(0.05), expected(0.5)
    assert quiet.p95_rad < loud.p95_rad
    assert true_quiet < 3.0 * quiet.p95_rad
    assert true_loud < 3.0 * loud.p95_rad


def test_where_half_of_the_features_are_too_few_the_error_is_unknown() -> None:
    fit = calibrate_scene_rig(room(5, count=900, noise_px=0.05)[0], SIZE)
    few = np.arange(len(fit.pairs.directions)) < 100
    fit = replace(fit, pairs=fit.pairs.only(few), residuals_px=fit.residuals_px[few], across_rad=fit.across_rad[few])
    told = pointing_error(fit, SIZE, held=False)
    assert told.p95_rad == math.inf
    assert told.document()["halves_p95_deg"] is None


@pytest.mark.parametrize(("covariance_deg", "halves_deg"), [(0.3, 0.1), (0.1, 0.3)])
def test_either_witness_refuses_and_the_verdict_is_told_first(covariance_deg, halves_deg) -> None:
    found = PointingError(covariance_rad=math.radians(covariance_deg), halves_rad=math.radians(halves_deg))
    said: list[str] = []
    with pytest.raises(CalibrationError, match=r"0\.300° at 95 %, is above the limit of 0\.2°, nothing was written"):
        judge(found, math.radians(0.2), said.append)
    judge(found, math.inf, said.append)
    assert said == [said[0]] * 2
    assert "expect a pointing error of 0.300° at 95 %" in said[0]
