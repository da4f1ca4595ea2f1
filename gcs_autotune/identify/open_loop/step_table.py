"""Calculate a model from each step (Miskovic2010, table 4.1), and test whether all steps agree.

``tau`` is the input after the step, including ``Delta``. All signs are as recorded. ``k_ss`` is the steady velocity
((4.28), (4.39)). ``eps_v`` is the velocity error (4.40), which is the value of the settled position line at the time of
the step. The closed forms of the table are special cases of two integrals along the response, :func:`lag` and
:func:`time_to`. The integrals apply to any structure and any velocity before the step.

A model with constant parameters gives the same numbers for any size and sign of the input. If the numbers differ,
:func:`unevenness` reports whether they depend on sign or size, or scatter more for small inputs. Each test has a
significance of 5 %, so a single result is a hint and not a proof.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.identify.doubt import Doubt
from gcs_autotune.identify.open_loop.steps import StepReading
from gcs_autotune.slow_imports import scipy_stats

__all__ = [
    "StepRow",
    "Unevenness",
    "lag",
    "linear_type_0",
    "linear_type_1",
    "nonlinear_type_0",
    "nonlinear_type_1",
    "row_from_table",
    "row_of",
    "steady",
    "time_to",
    "unevenness",
    "unevenness_doubts",
]

Array = NDArray[np.float64]

Drags = tuple[float, float]
"""Linear and quadratic drag (beta, beta_quadratic)."""

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(24)


def linear_type_1(tau: float, k_ss: float, eps_v: float, eta_0: float = 0.0) -> tuple[float, float]:
    """Return (alpha, beta) of a linear model from a step measured by its position, Miskovic2010 (4.43), (4.44)."""
    return (eta_0 - eps_v) * tau / k_ss**2, tau / k_ss


def nonlinear_type_1(tau: float, k_ss: float, eps_v: float, eta_0: float = 0.0) -> tuple[float, float]:
    """Return (alpha, beta_quadratic) of a nonlinear model from a step measured by its position, Miskovic2010 (4.47),
    (4.48).
    """
    return (eta_0 - eps_v) * tau / (k_ss**2 * math.log(2.0)), tau / (k_ss * abs(k_ss))


def linear_type_0(tau: float, K_ss: float, T_L: float) -> tuple[float, float]:
    """Return (alpha, beta) of a linear model from a step measured by its velocity, Miskovic2010 (4.31), (4.32).

    T_L : time to 63.2 % of the steady velocity [s], (4.33).
    """
    return T_L * tau / K_ss, tau / K_ss


def nonlinear_type_0(tau: float, K_ss: float, T_N: float) -> tuple[float, float]:
    """Return (alpha, beta_quadratic) of a nonlinear model from a step measured by its velocity, Miskovic2010 (4.36),
    (4.37).

    T_N : time to tanh(1) = 76.2 % of the steady velocity [s], (4.38).
    """
    return T_N * tau / K_ss, tau / (K_ss * abs(K_ss))


def steady(drags: Drags, tau: float) -> float:
    """Return the velocity at which drag balances *tau* (including Delta), Miskovic2010 (4.31) and (4.36)."""
    beta, quadratic = drags
    if quadratic == 0.0:
        return tau / beta
    sign = math.copysign(1.0, quadratic)
    force, b, c = sign * tau, sign * beta, abs(quadratic)
    return math.copysign((-b + math.sqrt(max(b * b + 4.0 * c * abs(force), 0.0))) / (2.0 * c), force)


def lag(alpha: float, drags: Drags, tau: float, nu_0: float) -> float:
    """Return the position lost during the transient, ``eta_0 - eps_v`` [rad or m].

    It is the integral of (k_ss - nu) dt over the response. From rest it is ``alpha*tau/beta^2`` for the linear model
    (4.44) and ``sgn(tau)*alpha/beta_nn*ln 2`` for the nonlinear one (4.48).
    """
    k = steady(drags, tau)
    return alpha * _along(drags, tau, nu_0, k, lambda nu: k - nu)


def time_to(alpha: float, drags: Drags, tau: float, nu_0: float, level: float) -> float:
    """Return the time [s] from the velocity *nu_0* to the velocity *level*, Miskovic2010 (4.32), (4.37).

    *level* must lie between *nu_0* and the steady velocity.
    """
    return alpha * _along(drags, tau, nu_0, level, np.ones_like)


def _along(drags: Drags, tau: float, nu_0: float, nu_1: float, weight: Callable[[Array], Array]) -> float:
    """Return the integral of weight(nu)/(tau - drag(nu)) from *nu_0* to *nu_1*.

    It is split where nu changes sign.
    """
    borders = [nu_0, 0.0, nu_1] if nu_0 * nu_1 < 0.0 else [nu_0, nu_1]
    total = 0.0
    for a, b in itertools.pairwise(borders):
        half = 0.5 * (b - a)
        nu = 0.5 * (a + b) + half * _NODES
        residual = tau - (drags[0] + drags[1] * np.abs(nu)) * nu
        total += half * float(_WEIGHTS @ (weight(nu) / residual))
    return total


SIGNIFICANCE = 0.05
"""Probability of a false alarm in each test for parameters that differ between the steps. Project choice."""

FEWEST = 4
"""Smallest number of steps per sign of the input for which the tests are run. Project choice."""


@dataclass(frozen=True, slots=True)
class StepRow:
    """Result of Miskovic2010, table 4.1, for one step.

    - ``tau``: input after the step.
    - ``k_ss``: steady velocity.
    - ``lag``: eta_0 - eps_v.
    - The two drags, and the inertia for each drag structure, NaN if unknown.
    """

    tau: float
    k_ss: float
    lag: float
    beta: float
    beta_quadratic: float
    alpha_linear: float
    alpha_nonlinear: float


def row_from_table(tau: float, k_ss: float, lag: float) -> StepRow:
    """Return the row of Miskovic2010, table 4.1, for a step from rest with the velocity error ``eps_v = eta_0 - lag``.

    lag : eta_0 - eps_v, with the sign of the motion.
    """
    alpha, beta = linear_type_1(tau, k_ss, -lag)
    alpha_nonlinear, beta_quadratic = nonlinear_type_1(tau, k_ss, -lag)
    return StepRow(tau, k_ss, lag, beta, beta_quadratic, alpha, alpha_nonlinear)


def row_of(reading: StepReading) -> StepRow | None:
    """Return the row of Miskovic2010, table 4.1, for one reading.

    Return None if the step did not start from rest, or if the craft did not move.
    """
    k = reading.k_ss.value
    rest = abs(reading.nu_0.value) < max(0.02 * abs(k), 3.0 * reading.nu_0.std)
    if abs(k) < 3.0 * reading.k_ss.std or k == 0.0 or reading.tau == 0.0 or reading.steady_only or not rest:
        return None
    if reading.has_lag:
        return row_from_table(reading.tau, k, reading.lag.value)
    if not reading.has_knee:
        return None
    alpha, beta = linear_type_0(reading.tau, k, reading.knee.value)
    quadratic = reading.tau / (k * abs(k))
    T_N = reading.knee.value / math.atanh(1.0 - math.exp(-1.0))  # tanh(t/T_N) = 63.2 % of (4.35)
    return StepRow(reading.tau, k, math.nan, beta, quadratic, alpha, T_N * reading.tau / k)


@dataclass(frozen=True, slots=True)
class Unevenness:
    """One significant dependence of ``parameter`` on the step.

    - ``kind``: ``sign``: the means of both signs of the input differ. ``size+``, ``size-``: the parameter changes with
      the size of the input of that sign. ``small``: the smallest third of the inputs has another mean.
      ``small-scatter``: the smallest third of the inputs scatters more.
    - ``effect``: a difference or a change over the range of inputs, relative to the mean; or the ratio of scatters less
      1.
    - ``p``: probability of a chance result.
    """

    parameter: str
    kind: Literal["sign", "size+", "size-", "small", "small-scatter"]
    effect: float
    p: float


def unevenness(tau: Sequence[float], values: Sequence[float], parameter: str) -> tuple[Unevenness, ...]:
    """Return every significant dependence of the parameter's *values* (n,) on the inputs *tau* (n,)."""
    x, y = np.asarray(tau, dtype=float), np.asarray(values, dtype=float)
    good = np.isfinite(y) & (x != 0.0)
    x, y = x[good], y[good]
    sides = {"+": x > 0.0, "-": x < 0.0}
    if min(int(s.sum()) for s in sides.values()) < FEWEST:
        return ()
    mean = float(y.mean())
    dependences = [_signs(x, y, parameter, mean)]
    for name, side in sides.items():
        line = scipy_stats().linregress(np.abs(x[side]), y[side])
        change = float(line.slope) * float(np.ptp(np.abs(x[side]))) / mean
        dependences.append(Unevenness(parameter, "size+" if name == "+" else "size-", change, float(line.pvalue)))
    dependences += _small(x, y, parameter, mean)
    return tuple(f for f in dependences if f.p < SIGNIFICANCE)


def _signs(x: Array, y: Array, parameter: str, mean: float) -> Unevenness:
    """Compare the means for both signs of the input.

    Steps of equal size and opposite sign are compared in pairs. Without such pairs, Welch's test is used.
    """
    order = np.argsort(np.abs(x), kind="stable")
    pairs = []
    for i, j in itertools.pairwise(order):
        if x[i] * x[j] < 0.0 and abs(abs(x[i]) - abs(x[j])) < 0.02 * abs(x[j]):
            pairs.append((y[i] - y[j]) * np.sign(x[i]))
    effect = float(y[x > 0.0].mean() - y[x < 0.0].mean()) / mean
    if 2 * len(pairs) == len(x):
        return Unevenness(parameter, "sign", effect, float(scipy_stats().ttest_1samp(pairs, 0.0).pvalue))
    test = scipy_stats().ttest_ind(y[x > 0.0], y[x < 0.0], equal_var=False)
    return Unevenness(parameter, "sign", effect, float(test.pvalue))


def _small(x: Array, y: Array, parameter: str, mean: float) -> list[Unevenness]:
    order = np.argsort(np.abs(x), kind="stable")
    third = max(len(x) // 3, 3)
    small, large = y[order[:third]], y[order[third:]]
    shift = float(scipy_stats().ttest_ind(small, large, equal_var=False).pvalue)
    ratio = float(small.var(ddof=1)) / max(float(large.var(ddof=1)), 1e-300)
    wider = float(scipy_stats().f.sf(ratio, len(small) - 1, len(large) - 1))
    return [
        Unevenness(parameter, "small", float(small.mean() - large.mean()) / mean, shift),
        Unevenness(parameter, "small-scatter", math.sqrt(ratio) - 1.0, wider),
    ]


def unevenness_doubts(rows: Sequence[StepRow], structure: str) -> list[Doubt]:
    """Return a doubt for each way in which the parameters of *structure* differ between the steps."""
    tau = [r.tau for r in rows]
    drag = [r.beta if structure == "linear" else r.beta_quadratic for r in rows]
    inertia = [r.alpha_linear if structure == "linear" else r.alpha_nonlinear for r in rows]
    dependences = (*unevenness(tau, drag, "drag"), *unevenness(tau, inertia, "inertia"))
    return [Doubt(f"uneven-{f.parameter}-{f.kind}", _sentence(f), _CURE) for f in dependences if structure != "affine"]


_CURE = (
    "a model with constant parameters is valid only on average. Identify each side, or the range you will use, "
    "separately"
)


def _sentence(unevenness: Unevenness) -> str:
    effect = f"{100.0 * unevenness.effect:+.0f} %"
    words = {
        "sign": f"{unevenness.parameter} differs between positive and negative inputs by {effect}",
        "size+": f"{unevenness.parameter} changes by {effect} from the smallest to the largest positive input",
        "size-": f"{unevenness.parameter} changes by {effect} from the smallest to the largest negative input",
        "small": f"{unevenness.parameter} for the smallest third of the inputs differs by {effect} from the others",
        "small-scatter": (
            f"{unevenness.parameter} scatters {effect} more for the smallest third of the inputs than for the others"
        ),
    }
    return f"{words[unevenness.kind]} (chance {unevenness.p:.1g})"
