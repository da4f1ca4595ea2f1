"""Numbers read off a record, each with the standard error its noise gives it.

A reading is a local least-squares polynomial evaluated where the definition asks for it: value, slope, curvature.
Its covariance carries the factor of correlated residuals (Newey1987, Bartlett weights), and never falls
below what the sensor's own step allows.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.identify.axis.uncertainty import autocorrelation

__all__ = ["LocalFit", "Reading", "local_fit", "mean_reading", "rate_of"]

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Reading:
    """One number with its standard error, both in ``unit`` (SI). NaN: not known."""

    value: float
    std: float
    unit: str = "1"

    def scaled(self, factor: float, unit: str) -> Reading:
        """Return the reading times an exact *factor*, in another unit."""
        return Reading(self.value * factor, self.std * abs(factor), unit)


@dataclass(frozen=True, slots=True, eq=False)
class LocalFit:
    """Polynomial about ``at`` [s]: coefficients (d+1,) in rising powers of (t - at) and their covariance."""

    at: float
    coefficients: Array
    covariance: Array
    sigma: float

    def value(self, unit: str) -> Reading:
        """Return the fitted value at ``at``."""
        return self._reading(0, unit)

    def slope(self, unit: str) -> Reading:
        """Return the fitted slope at ``at``."""
        return self._reading(1, unit)

    def _reading(self, i: int, unit: str) -> Reading:
        return Reading(float(self.coefficients[i]), math.sqrt(max(float(self.covariance[i, i]), 0.0)), unit)


def local_fit(t: Array, y: Array, at: float, degree: int, floor: float = 0.0) -> LocalFit:
    """Fit a polynomial of *degree* to (t, y) and give it about *at*.

    t, y : (n,) with n > degree. floor : least standard deviation of one sample, e.g. a sensor's step over sqrt(12).
    """
    scale = max(float(np.ptp(t)), 1e-12)
    s = (t - at) / scale
    table = np.vander(s, degree + 1, increasing=True)
    inverse = np.linalg.pinv(table.T @ table)
    c = inverse @ (table.T @ y)
    left = y - table @ c
    spare = max(len(t) - degree - 1, 1)
    roundoff = 1e-12 * max(float(np.max(np.abs(y))), 1e-300)
    sigma = max(math.sqrt(float(left @ left) / spare), floor, roundoff)
    shrink = scale ** -np.arange(degree + 1.0)
    covariance = inverse * sigma**2 * _colour(left) * np.outer(shrink, shrink)
    return LocalFit(at, c * shrink, covariance, sigma)


def mean_reading(t: Array, y: Array, unit: str, floor: float = 0.0) -> Reading:
    """Return the mean of (t, y) with the standard error of correlated samples."""
    return local_fit(t, y, float(t.mean()), 0, floor).value(unit)


def _colour(left: Array) -> float:
    """Return by how much correlation raises the variance of an average of these residuals, at least 1."""
    n = len(left)
    lags = min(int(2.0 * math.sqrt(n)), n // 4)
    if lags < 1:
        return 1.0
    weights = 1.0 - np.arange(1, lags + 1) / (lags + 1.0)
    return max(1.0, 1.0 + 2.0 * float(weights @ autocorrelation(left, lags)))


def rate_of(t: Array, angle: Array, width: float) -> Array:
    """Return the slope of *angle* at every stamp, by lines over *width* seconds (five samples at least).

    A line's slope is that of the parabola where the window lies evenly about the stamp; where it cannot, near the ends
    and beside holes, a parabola is fitted.
    """
    n = len(t)
    a, b = np.searchsorted(t, t - 0.5 * width), np.searchsorted(t, t + 0.5 * width, side="right")
    index = np.arange(n)
    a, b = np.clip(np.minimum(a, index - 2), 0, None), np.clip(np.maximum(b, index + 3), None, n)
    s, y = t - t.mean(), angle - angle.mean()
    sums = [np.concatenate([[0.0], np.cumsum(v)]) for v in (np.ones(n), s, y, s * s, s * y)]
    m, ms, my, mss, msy = (v[b] - v[a] for v in sums)
    with np.errstate(divide="ignore", invalid="ignore"):
        rate: Array = (msy - ms * my / m) / (mss - ms * ms / m)
    uneven = np.abs(ms / m - s) > 0.1 * (t[b - 1] - t[a])
    for i in np.flatnonzero(uneven | ~np.isfinite(rate)):
        first, last = max(min(a[i], n - 5), 0), min(max(b[i], 5), n)
        rate[i] = np.polyfit(t[first:last] - t[i], angle[first:last], min(2, last - first - 1))[-2]
    return rate
