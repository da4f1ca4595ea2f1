"""What a regression found, in the words of :class:`Fit`."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.identify.coupled.case import CoupledCase
from gcs_autotune.identify.doubts import POOR
from gcs_autotune.identify.free_run import fit_percent_of, runs_or_doubt
from gcs_autotune.identify.regression.motion import GriddedMotion
from gcs_autotune.identify.regression.solver import Estimate
from gcs_autotune.identify.result import Doubt, Fit, Parameter, Trace
from gcs_autotune.models import CoupledModel, Form

__all__ = ["fit_of", "model_of"]

Array = NDArray[np.float64]

BEYOND_NOISE = 2.0
"""Rms residual of the free run, in noise levels, that noise no longer excuses."""


def model_of(form: Form, theta: Array) -> CoupledModel:
    """Return *form* with the parameters (p,)."""
    return CoupledModel(form, dict(zip(form.parameters, theta.tolist(), strict=True)))


def fit_of(
    case: CoupledCase,
    estimate: Estimate,
    motions: Sequence[GriddedMotion],
    method: str,
    doubts: Sequence[Doubt],
    extra: Mapping[str, Any],
) -> Fit:
    """Return the :class:`Fit`; its traces are free runs, not the regression's own residuals."""
    form = estimate.equations.form
    model = model_of(form, estimate.theta)
    units = dict(zip(form.inputs, case.records[0].input_units, strict=True))
    p, f = len(form.parameters), len(form.free)
    covariance = np.zeros((p, p))
    covariance[:f, :f] = estimate.covariance
    parameters = {}
    for i, name in enumerate(form.parameters):
        std = math.sqrt(max(float(covariance[i, i]), 0.0))
        unit = form.unit_of(name, units)
        parameters[name] = Parameter(name, float(estimate.theta[i]), unit, std, "fitted" if i < f else "fixed")
    said = [note for record in case.records for note in record.notes] + list(doubts)
    traces, runaway = runs_or_doubt(model, case.records)
    noise, percent = _noise(motions), fit_percent_of(traces)
    said += [*runaway, *_poor(traces, percent, noise)]
    return Fit(
        dof="+".join(form.dofs),
        structure=form.name,
        method=method,
        model=model,
        parameters=parameters,
        covariance=covariance,
        fit_percent=percent,
        used=case.names,
        noise=noise,
        doubts=tuple(said),
        traces=traces,
        extra={"delay": form.known.get("delay", 0.0), **extra},
    )


def _poor(traces: Sequence[Trace], percent: float, noise: Mapping[str, float]) -> list[Doubt]:
    """Say so when the free run explains little and noise is no excuse."""
    beyond = []
    for name in dict.fromkeys(t.signal for t in traces):
        residual = np.concatenate([t.measured - t.fitted for t in traces if t.signal == name])
        if math.sqrt(float(np.mean(residual**2))) > BEYOND_NOISE * noise.get(name, 0.0):
            beyond.append(name)
    if percent >= POOR or not beyond:
        return []
    return [
        Doubt(
            "poor-fit",
            f"in a free run, the model explains only {percent:.0f} % of the motion, and misses {', '.join(beyond)} by "
            "more than their noise: the standard errors hold for the noise only",
            "an unknown delay, a missing term, wind or current may be at work: fit output-error, or give the delay",
        )
    ]


def _noise(motions: Sequence[GriddedMotion]) -> dict[str, float]:
    names = dict.fromkeys(n for m in motions for n in m.noise)
    return {n: math.sqrt(float(np.mean([m.noise[n] ** 2 for m in motions if n in m.noise]))) for n in names}
