"""Calculate standard errors of an estimate from the noise of the measured signals.

The residuals of a regression underestimate the error. A few windows contain most of the information, and there the fit
follows the noise. Therefore noise with the measured standard deviation is added to the signals again. Its effect on
smoothing, rows and estimate is calculated to first order. The standard error from coloured residuals
(:func:`.scores_covariance`) is used if it is larger, because it includes errors other than sensor noise. Correlations
are those of the information matrix.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.identify.doubt import Doubt
from gcs_autotune.identify.regression.motion import GriddedMotion, motion_of
from gcs_autotune.identify.regression.solver import Estimate
from gcs_autotune.identify.signals.segment import Segment
from gcs_autotune.models import Form

__all__ = ["NoiseDraw", "draw_noise", "excess_doubt", "raised", "with_noise"]

Array = NDArray[np.float64]

DRAWS = 32
"""Number of noise draws. The standard error estimated from them is accurate to ``1/sqrt(2*DRAWS)``, which is 12 %."""

FAR = 3.0
"""Ratio of an equation's rms error to that caused by noise. Above it, noise is not the only cause."""

SMALL = 0.003
"""Error of an equation, relative to its terms, that is ignored. Smoothing causes such errors even in clean data."""


@dataclass(frozen=True, slots=True, eq=False)
class NoiseDraw:
    """Records with noise added again, and their motions, smoothed with the settings of the measured ones."""

    records: tuple[Segment, ...]
    motions: tuple[GriddedMotion, ...]


def draw_noise(
    form: Form, derivative: str, records: Sequence[Segment], motions: Sequence[GriddedMotion]
) -> tuple[NoiseDraw, ...]:
    """Return :data:`DRAWS` noise draws, always the same for the same records."""
    rng = np.random.default_rng(1)
    draws = []
    for _ in range(DRAWS):
        noisy = tuple(with_noise(r, m, rng) for r, m in zip(records, motions, strict=True))
        moved = tuple(motion_of(r, form, derivative, m.settings) for r, m in zip(noisy, motions, strict=True))
        draws.append(NoiseDraw(noisy, moved))
    return tuple(draws)


def with_noise(record: Segment, motion: GriddedMotion, rng: np.random.Generator) -> Segment:
    """Return *record* with noise added to every signal, as large as the noise that smoothing removed."""
    signals = {
        name: replace(s, values=s.values + rng.normal(0.0, motion.noise[name], len(s.values)))
        for name, s in record.signals.items()
    }
    return replace(record, signals=signals)


def raised(estimate: Estimate, instruments: Array, bread: Array, errors: Sequence[Array], base: Array) -> Estimate:
    """Return *estimate* with its standard errors raised to those of the noise draws.

    Parameters
    ----------
    instruments : (n, k, f), weighted; for least squares, the Jacobian.
    bread : (f, f), inverse of the gain of the instruments.
    errors : (n, k) acceleration errors of every draw, with the parameters of *estimate*.
    base : (n, k) acceleration errors of the measured records, with the same parameters.
    """
    made = np.sqrt(np.mean([np.mean((e - base) ** 2, axis=0) for e in errors], axis=0))
    excess = np.sqrt(np.mean(estimate.errors**2, axis=0)) / np.maximum(made, 1e-300)
    moved = np.array([bread @ np.einsum("nif,ni->f", instruments, e - base, optimize=True) for e in errors])
    by_noise = np.mean(moved**2, axis=0)
    by_residuals = np.diag(estimate.covariance)
    std = np.sqrt(np.maximum(by_noise, by_residuals))
    like = bread @ bread.T if not np.allclose(bread, bread.T, rtol=1e-6) else bread
    scale = np.sqrt(np.maximum(np.abs(np.diag(like)), 1e-300))
    correlation = np.clip(like / np.outer(scale, scale), -1.0, 1.0)
    return replace(estimate, covariance=correlation * np.outer(std, std), excess=excess)


def excess_doubt(estimate: Estimate) -> Doubt | None:
    """Return a doubt if the errors of the equations are far larger than noise explains, else None."""
    equations, k = estimate.equations, len(estimate.equations.form.dofs)
    theta = np.append(estimate.theta, 1.0)
    missed = np.sqrt(np.mean((equations.E @ theta) ** 2, axis=0))
    size = np.sqrt(np.mean((np.abs(equations.E) @ np.abs(theta)) ** 2, axis=0))
    share = missed / np.maximum(size, 1e-300)
    excess = np.zeros(k) if estimate.excess is None else estimate.excess
    wrong = [(d, float(x)) for d, x, s in zip(equations.form.dofs, excess, share, strict=True) if x > FAR and s > SMALL]
    if not wrong:
        return None
    excesses = ", ".join(f"{dof} {factor:.0f} times" for dof, factor in wrong)
    return Doubt(
        "beyond-noise",
        f"the errors of the equations of motion exceed the signal noise ({excesses}), so the standard errors are "
        "too small",
        "check for an unknown delay, a missing term, wind or current. Supply the delay, add terms, or use output-error",
    )
