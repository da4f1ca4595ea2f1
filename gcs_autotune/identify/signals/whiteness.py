"""Test whether residuals are white, and calculate the effect of coloured ones on standard errors."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from gcs_autotune import chi_square

__all__ = [
    "Remainder",
    "all_white",
    "autocorrelation",
    "correlation_time",
    "explained",
    "remainder_of",
    "scores_covariance",
    "whiteness",
]

Array = NDArray[np.float64]

LAGS = 10
"""Number of lags in the whiteness test. Project choice.

At 10 Hz ten lags are one second, in which unmodelled lags show first.
"""

SIGNIFICANCE = 0.01
"""Probability that white residuals are classified as coloured. Project choice."""


NOISE_SHARE = 0.9
"""Fraction of the residual's rms that must be uncorrelated for all of it to count as noise. Project choice."""


@dataclass(frozen=True, slots=True)
class Remainder:
    """Residual of a signal (SI), and the amount of noise in it.

    - ``rms``: root mean square of the whole residual.
    - ``noise``: root mean square of the component that changes from sample to sample, as sensor noise does. The
      remaining component is correlated. It is motion that the model does not explain.
    - ``p``: p-value of the whiteness test, NaN if unknown.
    """

    rms: float
    noise: float
    p: float = field(default=math.nan, compare=False)

    @property
    def is_only_noise(self) -> bool:
        """Whether the residual shows no correlation, not even a small one."""
        return self.unexplained == 0.0 and not self.p < SIGNIFICANCE

    @property
    def unexplained(self) -> float:
        """Root mean square of the correlated component of the residual, 0 if the whole residual counts as noise."""
        if self.noise >= NOISE_SHARE * self.rms:
            return 0.0
        return math.sqrt(self.rms**2 - self.noise**2)


def remainder_of(errors: Sequence[Array], rounding: float = 0.0) -> Remainder:
    """Return the root mean square of a residual and of its noise component.

    The noise component is estimated from second differences, which suppress slow motion.

    errors : residuals, an array (n,) per run.
    rounding : standard deviation of the rounding error of a coarse sensor. This error repeats with the motion, but
        counts as noise.
    """
    together = np.concatenate([e[np.isfinite(e)] for e in errors]) if errors else np.zeros(0)
    if not len(together):
        return Remainder(math.nan, math.nan)
    rms = math.sqrt(float(np.mean(together**2)))
    second = np.concatenate([np.diff(e[np.isfinite(e)], n=2) for e in errors])
    noise = math.sqrt(float(np.mean(second**2)) / 6.0) if len(second) else rms
    known = [e[np.isfinite(e)] for e in errors]
    tested = [] if noise < rounding else [whiteness(e) for e in known if len(e) >= 4 * LAGS]
    p = min(1.0, len(tested) * min(tested)) if tested else math.nan
    return Remainder(rms, min(rms, max(noise, rounding)), p)


def autocorrelation(errors: Array, lags: int) -> Array:
    """Return the autocorrelation (lags,) of *errors* (n,) at lags 1..*lags*."""
    free = errors - errors.mean()
    power = float(free @ free)
    if power <= 0.0:
        return np.zeros(lags)
    return np.array([float(free[k:] @ free[:-k]) / power for k in range(1, lags + 1)])


def whiteness(errors: Array) -> float:
    """Return the probability that white residuals are at least as coloured as *errors* (n,) by chance (Ljung1978)."""
    n, lags = len(errors), min(LAGS, len(errors) // 4)
    rho = autocorrelation(errors, lags)
    statistic = n * (n + 2) * float(np.sum(rho**2 / (n - np.arange(1, lags + 1))))
    return chi_square.exceeded_by_chance(statistic, lags)


def all_white(scores: Sequence[Array]) -> bool:
    """Return whether all series in *scores* are white, with a Bonferroni correction for their number."""
    return all(whiteness(s) > SIGNIFICANCE / len(scores) for s in scores)


def correlation_time(scores: Sequence[Array]) -> float:
    """Return the number of samples that are equivalent to one independent sample.

    For each series it is ``1 + 2 sum rho_k``, summed up to the first lag with negligible correlation. The result is the
    median over the series, at least 1.
    """
    if all_white(scores):
        return 1.0
    times = []
    for own in scores:
        rho = autocorrelation(own, len(own) // 4)
        below = np.flatnonzero(rho < 0.05)
        times.append(1.0 + 2.0 * float(rho[: int(below[0]) if len(below) else len(rho)].sum()))
    return float(np.clip(np.median(times), 1.0, sum(len(s) for s in scores) / 20.0))


def scores_covariance(scores: Sequence[Array]) -> Array:
    """Return the covariance (p, p) of the sum of *scores*, which are (n, p) per series.

    Scores are correlated only within a series. Autocovariances up to ``2*sqrt(n)`` samples are used, with Bartlett
    weights (Newey1987).
    """
    p = scores[0].shape[1]
    S = np.zeros((p, p))
    for own in scores:
        reach = min(math.ceil(2.0 * math.sqrt(len(own))), len(own) - 1)
        S += own.T @ own
        for k in range(1, reach + 1):
            lagged = own[k:].T @ own[:-k]
            S += (1.0 - k / (reach + 1.0)) * (lagged + lagged.T)
    return S


def explained(parts: Iterable[tuple[str, Array, Array]]) -> dict[str, float]:
    """Return name of the signal -> 100 (1 - rms/std), for each signal that moves.

    parts : tuples of signal name, measured values (n,) and errors (n,).
    """
    power: dict[str, float] = {}
    squares: dict[str, float] = {}
    for name, measured, error in parts:
        power[name] = power.get(name, 0.0) + float(np.var(measured)) * len(measured)
        squares[name] = squares.get(name, 0.0) + float(error @ error)
    return {n: 100.0 * (1.0 - float(np.sqrt(squares[n] / p))) for n, p in power.items() if p > 0.0}
