"""Build a :class:`Fit` from the result of a regression."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from gcs_autotune.identify.case import Case
from gcs_autotune.identify.doubt import Doubt
from gcs_autotune.identify.doubts import POOR
from gcs_autotune.identify.fit_builder import Motion, fit_of, form_table, model_of
from gcs_autotune.identify.regression.motion import GriddedMotion
from gcs_autotune.identify.regression.solver import Estimate
from gcs_autotune.identify.result import Fit
from gcs_autotune.models import CoupledModel

__all__ = ["regression_fit"]

BEYOND_NOISE = 2.0
"""Rms residual of the free run, in noise levels, above which noise alone does not explain it."""


def regression_fit(
    case: Case,
    estimate: Estimate,
    motions: Sequence[GriddedMotion],
    method: str,
    doubts: Sequence[Doubt],
    extra: Mapping[str, Any],
) -> Fit[CoupledModel]:
    """Return the :class:`Fit` of a regression.

    Its traces are free runs, not the residuals of the regression.
    """
    form = estimate.equations.form
    model = model_of(form, estimate.theta)
    table = form_table(form, estimate.theta, case.input_units, form.free, estimate.covariance)
    motion = Motion.freely(model, case.records, _noise(motions))
    return fit_of(
        case,
        method,
        model,
        table,
        motion,
        structure=form.name,
        doubts=[*doubts, *motion.doubts, *_poor(motion)],
        extra={"delay": form.known.get("delay", 0.0), **extra},
    )


def _poor(motion: Motion) -> list[Doubt]:
    """Return a doubt if the free run explains little of the motion and noise is not the reason."""
    beyond, traces, percent = [], motion.traces, motion.fit_percent
    for name in dict.fromkeys(t.signal for t in traces):
        residual = np.concatenate([t.measured - t.fitted for t in traces if t.signal == name])
        if math.sqrt(float(np.mean(residual**2))) > BEYOND_NOISE * motion.noise.get(name, 0.0):
            beyond.append(name)
    if percent >= POOR or not beyond:
        return []
    return [
        Doubt(
            "poor-fit",
            f"in a free simulation, the model explains only {percent:.0f} % of the motion. The error of "
            f"{', '.join(beyond)} exceeds the noise, but the standard errors include only the noise",
            "check for an unknown delay, a missing term, wind or current. Use output-error, or supply the delay",
        )
    ]


def _noise(motions: Sequence[GriddedMotion]) -> dict[str, float]:
    names = dict.fromkeys(n for m in motions for n in m.noise)
    return {n: math.sqrt(float(np.mean([m.noise[n] ** 2 for m in motions if n in m.noise]))) for n in names}
