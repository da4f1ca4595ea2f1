"""What to doubt about a plan's result."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.identify.plan.combine import Agreement
from gcs_autotune.identify.plan.joint import Joint
from gcs_autotune.identify.plan.plan import Plan
from gcs_autotune.identify.plan.result import StepResult
from gcs_autotune.identify.result import Doubt, Parameter
from gcs_autotune.identify.validate import Validation

__all__ = ["plan_doubts"]

Array = NDArray[np.float64]

SURE = 1e-3
"""Chance of a false alarm, over all shared parameters together, below which steps are said to disagree."""

TOGETHER = 0.98
"""Correlation from which two parameters are said to move together."""

MISFIT = 1.3
"""Misfit of the joint fit per sample above which the steps' equations do not fit together."""


def plan_doubts(
    plan: Plan,
    done: Sequence[StepResult],
    rows: Sequence[Agreement],
    joint: Joint | None,
    parameters: Mapping[str, Parameter],
    covariance: Array,
    skipped: Sequence[str],
    final: Validation | None,
) -> tuple[Doubt, ...]:
    """Return the doubts about the whole; those about a step stand in its fit."""
    found: list[Doubt] = []
    if skipped:
        missed = dict.fromkeys(n for s in plan.steps if s.name in skipped for n in (*s.isolated, *s.shared))
        lost = [n for n in missed if n not in parameters]
        found.append(
            Doubt(
                "steps-without-runs",
                f"no runs for {', '.join(skipped)}" + (f"; not identified: {', '.join(lost)}" if lost else ""),
                "fly them, with the manoeuvre's name in the side file",
            )
        )
    for row in rows:
        if row.probability < SURE / len(rows):
            told = ", ".join(f"{s}: {v:.4g} ± {e:.2g}" for s, v, e in zip(row.steps, row.values, row.stds, strict=True))
            found.append(
                Doubt(
                    "steps-disagree",
                    f"{row.name} differs between steps by more than their errors ({told})",
                    "a step's equations lack something it excites, or the craft changed between them (load, trim)",
                )
            )
    if joint is None or not joint.converged:
        found.append(
            Doubt(
                "joint-fit-failed", "the fit of all runs at once did not settle", "look at the steps one by one first"
            )
        )
    elif joint.misfit > MISFIT:
        found.append(
            Doubt(
                "joint-misfit",
                f"all runs together fit {joint.misfit:.2f} times worse than each step alone",
                "one set of parameters does not explain all steps: look at those that disagree",
            )
        )
    found.extend(_together(parameters, covariance))
    fitted_on = [s.step.name for s in done if not s.unseen]
    if fitted_on:
        found.append(
            Doubt(
                "validated-on-itself",
                f"one run only for {', '.join(fitted_on)}: no unseen run to validate on",
                "repeat",
            )
        )
    if plan.final is not None and final is None:
        found.append(
            Doubt("no-final-validation", f"no usable run {plan.final.chosen}", "record free driving and give it too")
        )
    return tuple(found)


def _together(parameters: Mapping[str, Parameter], covariance: Array) -> list[Doubt]:
    names = list(parameters)
    std = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    R = covariance / np.outer(std, std)
    pairs = [
        (names[i], names[j], float(R[i, j]))
        for i in range(len(names))
        for j in range(i + 1, len(names))
        if abs(R[i, j]) > TOGETHER
    ]
    return [
        Doubt(
            "move-together",
            f"{a} and {b} move together (correlation {r:.3f}): the runs fix a combination of both better than either",
            "a manoeuvre that moves one without the other, or know one of them from ashore",
        )
        for a, b, r in pairs
    ]
