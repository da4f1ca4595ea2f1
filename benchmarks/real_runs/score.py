"""Fit of a prediction to what was measured."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from benchmarks.real_runs.runs import FIRST, OUTPUTS, STEP, Run

__all__ = ["fit_percents"]

Array = NDArray[np.float64]


def fit_percents(run: Run, Y: Array, psi: Array | None) -> dict[str, float]:
    """Return ``100 (1 - rms/std)`` of u, v, r and psi after the first second; -inf for a diverged simulation.

    Without a predicted heading it is the predicted r integrated from the measured heading.
    """
    if psi is None:
        turned = np.concatenate([[0.0], np.cumsum(0.5 * STEP * (Y[FIRST:, 2] + Y[FIRST - 1 : -1, 2]))])
        psi = run.psi.copy()
        psi[FIRST - 1 :] = run.psi[FIRST - 1] + turned
    found = {}
    for i, name in enumerate(OUTPUTS):
        keep = run.seen[:, i] & (np.arange(len(run.t)) >= FIRST)
        found[name] = _percent(run.Y[keep, i], Y[keep, i])
    found["psi"] = _percent(run.psi[FIRST:], psi[FIRST:])
    return found


def _percent(measured: Array, predicted: Array) -> float:
    if not np.all(np.isfinite(predicted)):
        return -math.inf
    return float(100.0 * (1.0 - np.sqrt(np.mean((measured - predicted) ** 2)) / np.std(measured)))
