"""Fit the decision's probability to a bench's records.

    python -m tests.bench.accuracy --scene room,yard --matchers sweep --json RECORDS.json
    python -m tests.bench.accuracy --scene warehouse --matchers sweep --json HELD_OUT.json
    python -m tests.bench.fit RECORDS.json [--test HELD_OUT.json]

Prints the coefficients for ``ptzd/control/planning/decision.py`` and how well they tell right (within 1°) from wrong.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

import numpy as np
from scipy.optimize import minimize
from scipy.special import expit

from ptzd.control.planning.decision import CHANCE_LEAD, CHANCE_SCORE

PENALTY = 0.02
"""On squared coefficients, so that separable data give finite ones; more evidence must not count against an answer."""


def features(rows: list[dict]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Design matrix as in `planning.decision.Model`, leads over the rivals, and whether the answer was right."""
    design, lead, right = [], [], []
    for row in rows:
        if row.get("score") is None or row.get("sigma_deg") is None or row["texture"] < 1.0:
            continue
        blur = np.log10(max(row["sigma_deg"], 0.01) / 0.05)
        margin = row["score"] - max(row["rival"], CHANCE_SCORE)
        design.append([1.0, margin, blur, 1.0 - row["in_view"]])
        lead.append(row["score"] - row["rival"])
        right.append(row["present"] and row["error_deg"] is not None and row["error_deg"] <= 1.0)
    return np.array(design), np.array(lead), np.array(right, dtype=float)


def chances(design: np.ndarray, lead: np.ndarray, w: np.ndarray) -> np.ndarray:
    return expit(design @ w) * expit(lead / CHANCE_LEAD)


def fit(design: np.ndarray, lead: np.ndarray, right: np.ndarray) -> np.ndarray:
    def loss(w: np.ndarray) -> float:
        chance = np.clip(chances(design, lead, w), 1e-9, 1.0 - 1e-9)
        likelihood = right * np.log(chance) + (1.0 - right) * np.log(1.0 - chance)
        return float(PENALTY * (w[1:] ** 2).sum() - likelihood.sum())

    signs = [(None, None), (0, None), (None, 0), (None, 0)]
    return np.asarray(minimize(loss, np.zeros(design.shape[1]), method="L-BFGS-B", bounds=signs).x)


def report(name: str, design: np.ndarray, lead: np.ndarray, right: np.ndarray, w: np.ndarray) -> None:
    probability = chances(design, lead, w)
    print(f"{name}: {len(right)} answers, {right.mean():.2f} right")
    for low, high in ((0.0, 0.2), (0.2, 0.5), (0.5, 0.8), (0.8, 0.9), (0.9, 0.97), (0.97, 1.01)):
        inside = (probability >= low) & (probability < high)
        if inside.any():
            print(f"  p {low:.2f}-{min(high, 1.0):.2f}: {inside.sum():4d} answers, {right[inside].mean():.3f} right")
    for threshold in (0.8, 0.9):
        told = probability >= threshold
        print(f"  p ≥ {threshold}: {right[told].mean():.3f} right, {told[right > 0].mean():.3f} of the right ones told")


def report_sigma(name: str, rows: list[dict]) -> None:
    """How many errors of right answers lie within one, two and three of the sigma they are told with."""
    right = [r for r in rows if r["present"] and r.get("told_sigma_deg") and r["found"] and r["error_deg"] <= 1.0]
    ratios = np.array([r["error_deg"] / r["told_sigma_deg"] for r in right])
    shares = ", ".join(f"{np.mean(ratios <= k):.3f} within {k} sigma" for k in (1, 2, 3))
    print(f"{name}: {len(right)} right answers told, {shares}")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("records", type=Path)
    parser.add_argument("--test", type=Path)
    parser.add_argument("--matcher", default="sweep")
    args = parser.parse_args()
    fitted = [r for r in json.loads(args.records.read_text()) if r["matcher"] == args.matcher]
    answers = features(fitted)
    w = fit(*answers)
    print(dict(zip(("bias", "margin", "blur", "hidden"), np.round(w, 2).tolist(), strict=True)))
    report("fitted", *answers, w)
    report_sigma("fitted", fitted)
    if args.test:
        rows = [r for r in json.loads(args.test.read_text()) if r["matcher"] == args.matcher]
        report("held out", *features(rows), w)
        report_sigma("held out", rows)
    return 0


if __name__ == "__main__":
    sys.exit(main())
