"""Are residuals white, and what do they cost when they are not: for every method that has residuals."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

__all__ = ["SIGNIFICANCE", "autocorrelation", "scores_covariance", "whiteness"]

Array = NDArray[np.float64]

LAGS = 10
"""Lags of the whiteness test. Chosen: a second at 10 Hz, where unmodelled lags show first."""

SIGNIFICANCE = 0.01
"""Chance of calling white residuals coloured."""


def autocorrelation(errors: Array, lags: int) -> Array:
    """Return the autocorrelation of *errors* at lags 1..*lags*."""
    free = errors - errors.mean()
    power = float(free @ free)
    if power <= 0.0:
        return np.zeros(lags)
    return np.array([float(free[k:] @ free[:-k]) / power for k in range(1, lags + 1)])


def whiteness(errors: Array) -> float:
    """Return the probability that white residuals look at least this coloured (Ljung and Box 1978)."""
    n, lags = len(errors), min(LAGS, len(errors) // 4)
    rho = autocorrelation(errors, lags)
    statistic = n * (n + 2) * float(np.sum(rho**2 / (n - np.arange(1, lags + 1))))
    return float(chi2.sf(statistic, lags))


def scores_covariance(scores: Sequence[Array]) -> Array:
    """Return the covariance (p, p) of the sum of *scores*, (n, p) per series, correlated within each.

    Autocovariances up to ``2*sqrt(n)`` samples with Bartlett weights (Newey and West 1987).
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
