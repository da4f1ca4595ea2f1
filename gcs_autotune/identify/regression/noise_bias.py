"""How far noise in the measured velocities has shifted a least-squares estimate.

The regressors hold noise, so least squares is biased. Its size is found by doing to the record once more what nature
did (simulation-extrapolation, Cook and Stefanski 1994): as much noise again is added to the signals, and the estimate
moves on by about what it has moved already.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.errors import AutotuneError
from gcs_autotune.identify.coupled.record import CoupledRecord
from gcs_autotune.identify.regression.motion import Motion
from gcs_autotune.identify.regression.recipe import Recipe
from gcs_autotune.identify.regression.solver import Estimate, solve
from gcs_autotune.identify.result import Doubt

__all__ = ["noise_bias", "noise_bias_doubt"]

Array = NDArray[np.float64]

DRAWS = 4
"""Noise records added. The shift is a mean, so few tell its size."""

WORTH_SAYING = 0.1
"""Shift, in standard errors, below which it is not worth a word."""

NAMED = 3
"""Parameters named in the doubt."""


def noise_bias(
    estimate: Estimate,
    recipe: Recipe,
    records: Sequence[CoupledRecord],
    motions: Sequence[Motion],
    *,
    robust: bool = False,
) -> Array:
    """Return the estimated bias (f,) of the free parameters; NaN where it could not be found."""
    rng = np.random.default_rng(0)
    moved = []
    for _ in range(DRAWS):
        noisier = [_with_noise(r, m, rng) for r, m in zip(records, motions, strict=True)]
        try:
            moved.append(solve(recipe.equations(noisier), [estimate.theta], robust=robust).free - estimate.free)
        except AutotuneError:
            continue
    return np.mean(moved, axis=0) if moved else np.full(len(estimate.free), np.nan)


def _with_noise(record: CoupledRecord, motion: Motion, rng: np.random.Generator) -> CoupledRecord:
    signals = {
        name: replace(s, values=s.values + rng.normal(0.0, motion.noise[name], len(s.values)))
        for name, s in record.signals.items()
    }
    return replace(record, signals=signals)


def noise_bias_doubt(estimate: Estimate, bias: Array) -> Doubt | None:
    """Return what to say about the bias; None when it is nothing against the standard errors."""
    std = np.sqrt(np.maximum(np.diag(estimate.covariance), 1e-300))
    share = np.abs(bias) / std
    if not np.any(share > WORTH_SAYING):
        return None
    worst = [int(i) for i in np.argsort(-np.nan_to_num(share))[:NAMED] if share[i] > WORTH_SAYING]
    names = estimate.equations.form.free
    told = ", ".join(f"{names[i]} by {bias[i]:+.3g} ({share[i]:.1f} standard errors)" for i in worst)
    return Doubt(
        "noise-bias",
        f"noise in the measured velocities shifts least squares: about {told}",
        "take instrumental-variables or output-error, which noise does not shift",
    )
