from __future__ import annotations

import pytest

from ptzd.app.fingerprint import fingerprint, versions


def test_the_same_machine_has_the_same_one() -> None:
    assert fingerprint() == fingerprint()
    assert all(isinstance(value, str) for value in fingerprint().values())
    assert versions().keys() >= {"ptzd", "python", "numpy", "opencv-python-headless", "scipy"}


@pytest.mark.parametrize(
    "variable",
    ["OPENCV_CPU_DISABLE", "OPENCV_IPP", "NPY_DISABLE_CPU_FEATURES", "OPENBLAS_CORETYPE", "OPENBLAS_NUM_THREADS"],
)
def test_other_code_for_the_same_cpu_is_another_one(monkeypatch: pytest.MonkeyPatch, variable: str) -> None:
    monkeypatch.delenv(variable, raising=False)
    before = fingerprint()
    monkeypatch.setenv(variable, "other")
    assert fingerprint() != before


def test_a_kernel_that_does_not_tell_the_cpu(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("ptzd.app.fingerprint.CPUINFO", type("Missing", (), {"read_text": _missing}))
    assert not fingerprint()["cpu_model"]


def _missing() -> str:
    raise FileNotFoundError
