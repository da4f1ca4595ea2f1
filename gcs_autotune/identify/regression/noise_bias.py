"""Estimate the bias of a least-squares estimate caused by noise and smoothing.

The regressors contain noise, and smoothing rounds off the corners at jumps of the input. Least squares is therefore
biased. To estimate the bias, the fitted model is simulated with the measured noise level. The error of least squares on
these runs is about equal to its real error (parametric bootstrap, Efron1993).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.errors import AutotuneError, NotInformative
from gcs_autotune.identify.doubt import Doubt
from gcs_autotune.identify.fit_builder import model_of
from gcs_autotune.identify.free_run import run_freely
from gcs_autotune.identify.regression.motion import GriddedMotion
from gcs_autotune.identify.regression.recipe import Recipe
from gcs_autotune.identify.regression.solver import Estimate, solve
from gcs_autotune.identify.regression.spread import with_noise
from gcs_autotune.identify.signals.segment import Segment

__all__ = ["as_simulated", "noise_bias", "noise_bias_doubt", "with_bias"]

Array = NDArray[np.float64]

DRAWS = 4
"""Number of simulated sets of records with noise.

Project choice: the bias is a mean over the sets, so a few are enough.
"""

NEGLIGIBLE = 0.1
"""Bias, in standard errors, below which no doubt is raised. Project choice."""

NAMED = 3
"""Maximum number of parameters listed in the doubt about noise bias. Project choice."""


def as_simulated(recipe: Recipe, records: Sequence[Segment], theta: Array) -> list[Segment]:
    """Return *records* with their measured signals replaced by a free run of the model.

    Raises
    ------
    NotInformative
        The model diverges.
    """
    model, clean = model_of(recipe.form, theta), []
    for record in records:
        signals = dict(record.signals)
        for trace in run_freely(model, record):
            signals[trace.signal] = replace(signals[trace.signal], values=trace.fitted)
        clean.append(replace(record, signals=signals))
    return clean


def noise_bias(
    estimate: Estimate,
    recipe: Recipe,
    records: Sequence[Segment],
    motions: Sequence[GriddedMotion],
    *,
    robust: bool = False,
) -> Array:
    """Return the estimated bias (f,) of the free parameters of *estimate*, NaN if its model cannot be simulated."""
    rng = np.random.default_rng(0)
    unknown = np.full(len(estimate.free), np.nan)
    try:
        clean = as_simulated(recipe, records, estimate.theta)
    except NotInformative:
        return unknown
    moved = []
    for _ in range(DRAWS):
        noisy = [with_noise(r, m, rng) for r, m in zip(clean, motions, strict=True)]
        try:
            moved.append(solve(recipe.equations(noisy), [estimate.theta], robust=robust).free - estimate.free)
        except AutotuneError:
            continue
    return np.mean(moved, axis=0) if moved else unknown


def with_bias(estimate: Estimate, bias: Array) -> Estimate:
    """Return *estimate* with the squared bias added to its covariance.

    A confidence interval has to cover the true value, not the mean result of the method.
    """
    known = np.nan_to_num(bias)
    return replace(estimate, covariance=estimate.covariance + np.outer(known, known))


def noise_bias_doubt(estimate: Estimate, bias: Array) -> Doubt | None:
    """Return a doubt about the bias, or None if it is small compared with the standard errors."""
    std = np.sqrt(np.maximum(np.diag(estimate.covariance), 0.0))
    share = np.nan_to_num(np.abs(bias) / np.maximum(std, 1e-9 * np.abs(estimate.free) + 1e-300))
    worst = [int(i) for i in np.argsort(-share)[:NAMED] if share[i] > NEGLIGIBLE]
    if not worst:
        return None
    names = estimate.equations.form.free
    biases = ", ".join(f"{names[i]} by {bias[i]:+.3g} ({share[i]:.1f} standard errors)" for i in worst)
    return Doubt(
        "noise-bias",
        f"measurement noise and smoothing bias the least-squares estimate approximately as follows: {biases}",
        "use instrumental-variables or output-error, which they do not bias",
    )
