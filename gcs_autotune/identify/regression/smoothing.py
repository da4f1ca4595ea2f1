"""Smooth a noisy, unevenly sampled signal, and return its value, rate and acceleration at any times.

There are two methods. In both, the degree of smoothing is chosen from the data:

* ``savitzky-golay``: a polynomial through the nearest samples, which is the filter of Miskovic2007, II-C, for uneven
  stamps;
* ``smoothing``: a regularised spline (B-splines with a difference penalty, Eilers1996). Generalised cross-validation
  sets the penalty (Craven1979). For a coarse sensor the rounding error sets it, if that exceeds the scatter from
  cross-validation.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline
from scipy.linalg import solveh_banded
from scipy.optimize import minimize_scalar

from gcs_autotune.identify.signals.segment import Signal
from gcs_autotune.smoothing import best_width, local_polynomials

__all__ = ["SMOOTHERS", "Smooth", "Smoother", "local_polynomial", "penalised_spline"]

Array = NDArray[np.float64]

WIDTHS = (5, 7, 9, 13, 19, 27, 39)
"""Numbers of samples that a local polynomial may cover. The best one is chosen for each signal. Project choice."""

CUBIC = 3
"""Degree of the local polynomials. It is the lowest for which the second derivative can have a slope."""

MOST_SPLINES = 1500
"""Maximum number of B-splines per signal.

Project choice: the computing time grows linearly with it, and no craft needs a finer curve.
"""

EXACT = 120
"""Number of splines up to which the degrees of freedom of the smoother are calculated exactly. Project choice."""

PROBES = 32
"""Number of random probes that estimate the degrees of freedom of the smoother for more splines (Hutchinson1990).

The relative error is about ``1/sqrt(PROBES * splines)``.
"""


@dataclass(frozen=True, slots=True, eq=False)
class Smooth:
    """A smoothed signal.

    - ``at(t, order)``: derivative of that order at the times *t* (n,).
    - ``noise``: standard deviation of what was removed, per sample. It may be NaN if the setting was supplied.
    - ``setting``: number of samples or penalty, to smooth another signal in the same way.
    - ``reach`` [s]: half-width of the neighbourhood that affects a value. It may be NaN if the setting was supplied.
    """

    at: Callable[[Array, int], Array]
    noise: float
    setting: float
    reach: float


Smoother = Callable[[Signal, int, "float | None"], Smooth]
"""Type of a function of (signal, highest derivative needed, setting or None) that returns a :class:`Smooth`."""


def local_polynomial(signal: Signal, order: int, setting: float | None = None) -> Smooth:
    """Return *signal* smoothed by cubic polynomials through the nearest *setting* samples.

    None chooses the number of samples.
    """
    n = len(signal.t)
    widths = [int(setting)] if setting is not None else [w for w in WIDTHS if w < n] or [min(n, WIDTHS[0])]
    width, noise = best_width(signal.t, signal.values, widths, CUBIC)

    def at(t: Array, derivative: int) -> Array:
        return local_polynomials(signal.t, signal.values, t, width, CUBIC).derivative(derivative)

    reach = 0.5 * width * float(np.median(np.diff(signal.t)))
    return Smooth(at, noise, float(width), reach)


def penalised_spline(signal: Signal, order: int, setting: float | None = None) -> Smooth:
    """Return *signal* smoothed by a spline with a penalty on the (order + 1)-th derivative, so that the *order*-th is
    smooth.

    order : 1 for velocities (a cubic spline), 2 for positions (quintic).
    setting : penalty relative to the weight of the data; None chooses it.
    """
    penalty_order = order + 1
    fit = _PSpline(signal, 2 * order + 1, penalty_order)
    noise = reach = math.nan
    if setting is None:
        low, high = -8.0, 12.0
        optimum = minimize_scalar(lambda e: fit.cross_validation(10.0**e), bounds=(low, high), method="bounded")
        exponent = float(optimum.x)
        floor = signal.step / math.sqrt(12.0)
        if floor > 0.0 and fit.noise(10.0**exponent) < floor:
            exponent = _where_noise_is(fit, floor, exponent, high)
        setting = 10.0**exponent
        noise = fit.noise(setting)
        reach = 0.5 * float(signal.t[-1] - signal.t[0]) / max(fit.freedom(setting), 2.0)
    coefficients = fit.coefficients(setting)
    spline = BSpline(fit.knots, coefficients, fit.degree)

    def at(t: Array, derivative: int) -> Array:
        inside = np.clip(t, signal.t[0], signal.t[-1])
        return np.asarray(spline(inside, nu=derivative), dtype=np.float64)

    return Smooth(at, noise, setting, reach)


def _where_noise_is(fit: _PSpline, floor: float, low: float, high: float) -> float:
    """Return the exponent of the penalty at which the scatter about the curve is *floor*, by bisection."""
    if fit.noise(10.0**high) < floor:
        return high
    for _ in range(30):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if fit.noise(10.0**middle) < floor else (low, middle)
    return high


class _PSpline:
    """Least-squares fit of B-splines on even knots, with a penalty on differences of their coefficients.

    All matrices are banded.
    """

    def __init__(self, signal: Signal, degree: int, penalty_order: int) -> None:
        t, self.degree = signal.t, degree
        length = float(t[-1] - t[0])
        pieces = int(np.clip(round(length / float(np.median(np.diff(t)))), 4, MOST_SPLINES))
        self.knots = t[0] + length / pieces * np.arange(-degree, pieces + degree + 1)
        self.count = pieces + degree
        self.n, self.values = len(t), signal.values
        self.first = np.clip(np.searchsorted(self.knots, t, side="right") - 1, degree, self.count - 1) - degree
        self.local = _local_values(self.knots, t, degree, self.first)
        self.gram = np.zeros((degree + 1, self.count))
        for k in range(degree + 1):
            for j in range(degree + 1 - k):
                np.add.at(self.gram[k], self.first + j, self.local[:, j] * self.local[:, j + k])
        self.penalty = _difference_penalty(self.count, penalty_order, degree + 1)
        self.scale = float(self.gram[0].sum() / self.penalty[0].sum())
        self.right = np.zeros(self.count)
        for j in range(degree + 1):
            np.add.at(self.right, self.first + j, self.local[:, j] * self.values)

    @cached_property
    def _probes(self) -> tuple[Array, Array, float]:
        """Return the probes, the Gram matrix times the probes, and the weight of one probe."""
        if self.count <= EXACT:
            return np.eye(self.count), _banded_times(self.gram, np.eye(self.count)), 1.0
        probes = np.random.default_rng(0).choice([-1.0, 1.0], (self.count, PROBES))
        return probes, _banded_times(self.gram, probes), 1.0 / PROBES

    def _solve(self, penalty: float, right: Array) -> Array:
        A = self.gram + penalty * self.scale * self.penalty
        A[0] += 1e-12 * A[0].max()
        return np.asarray(solveh_banded(A, right, lower=True, check_finite=False), dtype=np.float64)

    def coefficients(self, penalty: float) -> Array:
        return self._solve(penalty, self.right)

    def freedom(self, penalty: float) -> float:
        """Return the effective number of parameters, which is the trace of the smoother."""
        probes, through, share = self._probes
        return share * float(np.sum(probes * self._solve(penalty, through)))

    def _left(self, penalty: float) -> float:
        c = self.coefficients(penalty)
        fitted = sum(self.local[:, j] * c[self.first + j] for j in range(self.degree + 1))
        residual = self.values - fitted
        return float(residual @ residual)

    def cross_validation(self, penalty: float) -> float:
        """Return the logarithm of the generalised cross-validation score."""
        rest = max(self.n - self.freedom(penalty), 1e-3 * self.n)
        return math.log(max(self._left(penalty), 1e-300)) - 2.0 * math.log(rest)

    def noise(self, penalty: float) -> float:
        return math.sqrt(self._left(penalty) / max(self.n - self.freedom(penalty), 1e-3 * self.n))


def _local_values(knots: Array, t: Array, degree: int, first: NDArray[np.intp]) -> Array:
    """Return the values of the degree + 1 nonzero B-splines (n, degree + 1) at each of *t* (de Boor's recursion)."""
    place = first + degree
    B = np.zeros((len(t), degree + 1))
    B[:, degree] = 1.0
    for d in range(1, degree + 1):
        for j in range(degree - d, degree + 1):
            i = place - degree + j
            left = (t - knots[i]) / (knots[i + d] - knots[i]) * B[:, j]
            right = (knots[i + d + 1] - t) / (knots[i + d + 1] - knots[i + 1]) * B[:, j + 1] if j < degree else 0.0
            B[:, j] = left + right
    return B


def _difference_penalty(count: int, order: int, rows: int) -> Array:
    """Return the lower band (rows, count) of D'D, where D takes differences of *order*."""
    weights = np.array([(-1.0) ** k * math.comb(order, k) for k in range(order + 1)])
    band = np.zeros((rows, count))
    for i in range(order + 1):
        for j in range(i, order + 1):
            band[j - i, i : i + count - order] += weights[i] * weights[j]
    return band


def _banded_times(band: Array, X: Array) -> Array:
    """Return the product of a symmetric matrix, stored as its lower *band*, and *X* (count, m)."""
    out: Array = band[0][:, None] * X
    for k in range(1, len(band)):
        off = band[k, : len(X) - k][:, None]
        out[k:] += off * X[:-k]
        out[:-k] += off * X[k:]
    return out


SMOOTHERS: Mapping[str, Smoother] = {"smoothing": penalised_spline, "savitzky-golay": local_polynomial}
"""Value of the option ``derivative`` -> smoother."""
