"""What to doubt about a filter's answer: its innovations, its parameters' last moves, what the run never showed."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gcs_autotune import chi_square
from gcs_autotune.identify.doubts import COLOUR
from gcs_autotune.identify.kalman.filter_bank import FilterResult
from gcs_autotune.identify.kalman.task import Task
from gcs_autotune.identify.result import Doubt
from gcs_autotune.models import CoupledModel

__all__ = ["filter_doubts"]

Array = NDArray[np.float64]

MOVING = 0.5
"""Last move of a parameter, in standard errors, above which it has not settled."""

UNSEEN = 0.5
"""Standard error over prior spread above which a run has told next to nothing of a parameter."""


def filter_doubts(task: Task, last: FilterResult, moved: Array, std: Array, model: CoupledModel) -> tuple[Doubt, ...]:
    """Return the doubts about a fit whose last pass and last parameter moves (p,) are given."""
    doubts = [*_consistency(task, last)]
    names = [n for n in task.bank.free if not task.is_shift(n)]
    own = [task.bank.free.index(n) for n in names]
    moved, std, widest = moved[own], std[own], (task.spread * task.start.scale)[own]
    restless = [n for n, m in zip(names, moved, strict=True) if m > MOVING]
    if restless:
        doubts.append(
            Doubt(
                "still-moving",
                f"{', '.join(restless)} still moved by more than {MOVING} standard errors in the last round",
                "allow more passes, or give start values nearer to the craft",
            )
        )
    unseen = [n for n, s, w in zip(names, std, widest, strict=True) if s > UNSEEN * w]
    if unseen:
        doubts.append(
            Doubt(
                "not-seen",
                f"these runs hardly tell of {', '.join(unseen)}: what is printed is mostly the start value",
                "fly a manoeuvre that moves what they act on, or leave them out of the form",
            )
        )
    M = model.inertia
    if np.any(np.linalg.eigvalsh(0.5 * (M + M.T)) <= 0.0):
        doubts.append(
            Doubt(
                "inertia-not-positive",
                "the inertia matrix found is not positive definite, which no craft has",
                "fly steps of the inputs, so that accelerations tell the inertia; check the signs of the inputs",
            )
        )
    return tuple(doubts)


def _consistency(task: Task, last: FilterResult) -> list[Doubt]:
    e, S = last.innovations
    doubts = []
    for j, name in enumerate(task.bank.signals):
        seen = ~np.isnan(S[:, j])
        z = (e[:, j] / np.sqrt(S[:, j]))[seen]
        n = len(z)
        nis, low, high = float(z @ z), chi_square.quantile(0.0005, n), chi_square.quantile(0.9995, n)
        if not 0.9 * low <= nis <= 1.1 * high:
            doubts.append(
                Doubt(
                    "filter-inconsistent",
                    f"{name}: innovations are {np.sqrt(nis / n):.2f} times as large as the filter expects (NIS test)",
                    "leave the noise levels to be estimated; if they were, the form lacks what moves the craft",
                )
            )
        colour = float(z[1:] @ z[:-1] / max(nis, 1e-300))
        if abs(colour) > max(COLOUR, 4.0 / np.sqrt(n)):
            doubts.append(
                Doubt(
                    "innovations-coloured",
                    f"{name}: neighbouring innovations are correlated by {colour:+.2f}: they hold motion, not noise",
                    "the form lacks what moves the craft; or the sensor filters its signal",
                )
            )
    return doubts
