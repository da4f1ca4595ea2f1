"""Each step by itself through Miskovic2010, table 4.1, and whether the steps tell one story.

A model of constant parameters gives the same numbers whatever the size and sign of the input. Where they differ, the
tests below say how: by sign, by size, or in their scatter. Each is made at 5 %: a hint where to look, no proof.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.identify.result import Doubt
from gcs_autotune.identify.ship.step_table import linear_type_0, linear_type_1, nonlinear_type_1
from gcs_autotune.identify.ship.steps import StepReading
from gcs_autotune.slow_imports import scipy_stats

__all__ = ["StepRow", "Unevenness", "row_from_table", "row_of", "unevenness", "unevenness_doubts"]

Array = NDArray[np.float64]

SIGNIFICANCE = 0.05
"""Chance of each test to speak up without reason."""

FEWEST = 4
"""Steps a side below which nothing is tested."""


@dataclass(frozen=True, slots=True)
class StepRow:
    """One step through table 4.1: both drags, and the inertia of either structure (NaN where not readable)."""

    tau: float
    k_ss: float
    lag: float
    beta: float
    beta_quadratic: float
    alpha_linear: float
    alpha_nonlinear: float


def row_from_table(tau: float, k_ss: float, lag: float) -> StepRow:
    """Return the row of a step from rest whose velocity error is ``eps_v = eta_0 - lag``; Miskovic2010, table 4.1.

    lag : of the sign of the motion, as eta_0 - eps_v comes out.
    """
    alpha, beta = linear_type_1(tau, k_ss, -lag)
    alpha_nonlinear, beta_quadratic = nonlinear_type_1(tau, k_ss, -lag)
    return StepRow(tau, k_ss, lag, beta, beta_quadratic, alpha, alpha_nonlinear)


def row_of(reading: StepReading) -> StepRow | None:
    """Return one reading through table 4.1; None when it did not start from rest or stands still."""
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
    """One way in which ``parameter`` is not constant over the steps.

    ``kind``: ``sign`` (means of both signs differ), ``size+``/``size-`` (falls or rises with the input on that side),
    ``small`` (the smallest third has another mean), ``small-scatter`` (it scatters more). ``effect`` is relative to the
    mean: a difference, the change over the range of inputs, or the ratio of scatters less 1. ``p``: chance of it.
    """

    parameter: str
    kind: Literal["sign", "size+", "size-", "small", "small-scatter"]
    effect: float
    p: float


def unevenness(tau: Sequence[float], values: Sequence[float], parameter: str) -> tuple[Unevenness, ...]:
    """Return every significant way in which *values* depend on the input *tau*; (n,) each."""
    x, y = np.asarray(tau, dtype=float), np.asarray(values, dtype=float)
    good = np.isfinite(y) & (x != 0.0)
    x, y = x[good], y[good]
    sides = {"+": x > 0.0, "-": x < 0.0}
    if min(int(s.sum()) for s in sides.values()) < FEWEST:
        return ()
    mean = float(y.mean())
    found = [_signs(x, y, parameter, mean)]
    for name, side in sides.items():
        line = scipy_stats().linregress(np.abs(x[side]), y[side])
        change = float(line.slope) * float(np.ptp(np.abs(x[side]))) / mean
        found.append(Unevenness(parameter, "size+" if name == "+" else "size-", change, float(line.pvalue)))
    found += _small(x, y, parameter, mean)
    return tuple(f for f in found if f.p < SIGNIFICANCE)


def _signs(x: Array, y: Array, parameter: str, mean: float) -> Unevenness:
    """Compare both signs: in pairs of the same size when the steps come in pairs, else by Welch's test."""
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
    """Return a doubt for every way in which the parameters of *structure* are not constant over the steps."""
    tau = [r.tau for r in rows]
    drag = [r.beta if structure == "linear" else r.beta_quadratic for r in rows]
    inertia = [r.alpha_linear if structure == "linear" else r.alpha_nonlinear for r in rows]
    found = (*unevenness(tau, drag, "drag"), *unevenness(tau, inertia, "inertia"))
    return [Doubt(f"uneven-{f.parameter}-{f.kind}", _sentence(f), _CURE) for f in found if structure != "affine"]


_CURE = "one model of constant parameters holds on average only: identify the sides or the range you will use alone"


def _sentence(found: Unevenness) -> str:
    effect = f"{100.0 * found.effect:+.0f} %"
    words = {
        "sign": f"{found.parameter} differs between positive and negative inputs by {effect}",
        "size+": f"{found.parameter} changes by {effect} from the smallest to the largest positive input",
        "size-": f"{found.parameter} changes by {effect} from the smallest to the largest negative input",
        "small": f"{found.parameter} of the smallest third of the inputs lies {effect} off the others",
        "small-scatter": f"{found.parameter} of the smallest third of the inputs scatters {effect} beyond the others",
    }
    return f"{words[found.kind]} (chance {found.p:.1g})"
