"""Determine values with standard errors from a record, and find the intervals in which an input is constant.

A reading is the value, slope or curvature of a local least-squares polynomial at a given time. Its covariance includes
a factor for correlated residuals (Newey1987, Bartlett weights). The noise is at least that of the sensor's resolution.
"""

from __future__ import annotations

import itertools
import math
from collections import deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.identify.signals.whiteness import autocorrelation

__all__ = ["Hold", "LocalFit", "Reading", "find_holds", "local_fit", "mean_reading", "rate_of"]

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Reading:
    """A value and its standard error, both in ``unit`` (SI). NaN if unknown."""

    value: float
    std: float
    unit: str = "1"

    def scaled(self, factor: float, unit: str) -> Reading:
        """Return the reading multiplied by an exact *factor*, in another unit."""
        return Reading(self.value * factor, self.std * abs(factor), unit)


@dataclass(frozen=True, slots=True, eq=False)
class LocalFit:
    """Local polynomial about the time ``at`` [s].

    - ``coefficients`` (d+1,): coefficients of the rising powers of (t - at).
    - ``covariance`` (d+1, d+1): covariance of the coefficients.
    - ``sigma``: standard deviation of the noise of one sample.
    """

    at: float
    coefficients: Array
    covariance: Array
    sigma: float

    def value(self, unit: str) -> Reading:
        """Return the value of the polynomial at the time ``at``, with its standard error."""
        return self._reading(0, unit)

    def slope(self, unit: str) -> Reading:
        """Return the slope of the polynomial at the time ``at``, with its standard error."""
        return self._reading(1, unit)

    def _reading(self, i: int, unit: str) -> Reading:
        return Reading(float(self.coefficients[i]), math.sqrt(max(float(self.covariance[i, i]), 0.0)), unit)


def local_fit(t: Array, y: Array, at: float, degree: int, floor: float = 0.0) -> LocalFit:
    """Return a polynomial of *degree*, fitted to (t, y) and expressed about the time *at*.

    t, y : (n,) with n > degree.
    floor : smallest standard deviation of one sample, for example the resolution of the sensor divided by sqrt(12).
    """
    scale = max(float(np.ptp(t)), 1e-12)
    s = (t - at) / scale
    table = np.vander(s, degree + 1, increasing=True)
    inverse = np.linalg.pinv(table.T @ table)
    c = inverse @ (table.T @ y)
    residual = y - table @ c
    spare = max(len(t) - degree - 1, 1)
    roundoff = 1e-12 * max(float(np.max(np.abs(y))), 1e-300)
    sigma = max(math.sqrt(float(residual @ residual) / spare), floor, roundoff)
    shrink = scale ** -np.arange(degree + 1.0)
    covariance = inverse * sigma**2 * _colour(residual) * np.outer(shrink, shrink)
    return LocalFit(at, c * shrink, covariance, sigma)


def mean_reading(t: Array, y: Array, unit: str, floor: float = 0.0) -> Reading:
    """Return the mean of *y*, with a standard error that includes the correlation of the samples."""
    return local_fit(t, y, float(t.mean()), 0, floor).value(unit)


def _colour(left: Array) -> float:
    """Return the factor, at least 1, by which correlation of the residuals raises the variance of their mean."""
    n = len(left)
    lags = min(int(2.0 * math.sqrt(n)), n // 4)
    if lags < 1:
        return 1.0
    weights = 1.0 - np.arange(1, lags + 1) / (lags + 1.0)
    return max(1.0, 1.0 + 2.0 * float(weights @ autocorrelation(left, lags)))


def rate_of(t: Array, angle: Array, width: float) -> Array:
    """Return the slope (n,) of *angle* [1/s] at every stamp, from lines over *width* seconds (at least five samples).

    If the window is symmetric about the stamp, the slope of a line equals that of a parabola. Near the ends and gaps
    the window is not symmetric, and a parabola is fitted.
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


NARROW, WIDE = 0.005, 0.05
"""Limits of the band within which an input counts as constant, as fractions of its whole range. Project choice."""

STILL = 0.6
"""Fraction of the time for which an input must be exactly constant to count as a command. Project choice.

The band for constant intervals is then narrow.
"""

LONGER = 3.0
"""Minimum duration of a hold, as a multiple of the time in which the fastest ramp crosses the band. Project choice."""


@dataclass(frozen=True, slots=True)
class Hold:
    """Interval in which the input is constant.

    - ``level``: value of the input.
    - ``start``, ``end`` [s]: times at which the interval starts and ends.
    - ``before`` [s]: end of the previous hold.
    """

    start: float
    end: float
    level: float
    before: float

    @property
    def duration(self) -> float:
        """Duration of the hold [s]."""
        return self.end - self.start


def find_holds(t: Array, values: Array, end: float, shortest: float = 0.0) -> tuple[Hold, ...]:
    """Return the intervals in which an input is constant, in order of time.

    t, values : (n,) samples of the input. Each value applies until the next stamp.
    end : end of the last sample [s].
    shortest : minimum duration [s]. The limit that prevents pieces of a rudder ramp from counting as holds also
        applies.
    """
    span = float(np.ptp(values)) if len(values) else 0.0
    if span == 0.0:
        return ()
    change = np.concatenate([[True], np.diff(values) != 0.0])
    t, values = t[change], values[change]
    ends = np.append(t[1:], end)
    band = _band(t, values, end, span)
    far = _reach(values, band)
    least = max(shortest, _ramp_time(t, values, band) * LONGER)
    pieces = _longest_first(t, ends, far, least)
    holds: list[Hold] = []
    for i, j in pieces:
        held = ends[i : j + 1] - t[i : j + 1]
        level = float(np.average(values[i : j + 1], weights=np.maximum(held, 1e-9)))
        begin, stop = float(t[i]), float(min(ends[j], end))
        if holds and abs(level - holds[-1].level) < 0.5 * band:
            holds[-1] = Hold(holds[-1].start, stop, holds[-1].level, holds[-1].before)
        else:
            holds.append(Hold(begin, stop, level, holds[-1].end if holds else begin))
    return tuple(holds)


def _band(t: Array, values: Array, end: float, span: float) -> float:
    """Return the band in which a held input may vary: narrow for a command, else from its noise."""
    held = np.diff(np.append(t, max(end, float(t[-1]))))
    tick = float(np.percentile(held[held > 0.0], 5)) if (held > 0.0).any() else 0.0
    if float(held[held > 8.0 * tick].sum()) > STILL * float(held.sum()) or len(values) < 20:
        return NARROW * span
    noise = 1.4826 * float(np.median(np.abs(np.diff(values))))
    return float(np.clip(6.0 * noise, 2.0 * NARROW * span, WIDE * span))


def _reach(values: Array, band: float) -> NDArray[np.intp]:
    """Return for every sample the last one up to which all values lie within *band* of each other."""
    low: deque[int] = deque()
    high: deque[int] = deque()
    far, j = np.empty(len(values), dtype=np.intp), 0
    for i in range(len(values)):
        while j < len(values):
            lowest = min(values[low[0]], values[j]) if low else values[j]
            highest = max(values[high[0]], values[j]) if high else values[j]
            if highest - lowest > band:
                break
            while low and values[low[-1]] >= values[j]:
                low.pop()
            while high and values[high[-1]] <= values[j]:
                high.pop()
            low.append(j)
            high.append(j)
            j += 1
        far[i] = j - 1
        for queue in (low, high):
            if queue and queue[0] == i:
                queue.popleft()
    return far


def _ramp_time(t: Array, values: Array, band: float) -> float:
    """Return the time [s] the input needs to cross *band* on its fastest ramps, 0 if it only jumps."""
    times = []
    for (t_0, v_0), (t_1, v_1) in itertools.pairwise(zip(t, values, strict=True)):
        if 0.02 * band < abs(v_1 - v_0) < 4.0 * band:
            times.append((t_1 - t_0) * band / abs(v_1 - v_0))
    return float(np.percentile(times, 10)) if len(times) > 3 else 0.0


def _longest_first(t: Array, ends: Array, far: NDArray[np.intp], least: float) -> list[tuple[int, int]]:
    """Return disjoint index ranges of at least *least* seconds, in order.

    The longest ranges are chosen first.
    """
    order = np.argsort(-(ends[far] - t), kind="stable")
    taken = np.zeros(len(t), dtype=bool)
    chosen: list[tuple[int, int]] = []
    for i in order:
        j = int(far[i])
        if ends[j] - t[i] <= least:
            break
        if taken[i]:
            continue
        blocked = np.flatnonzero(taken[i : j + 1])
        if len(blocked):
            j = int(i) + int(blocked[0]) - 1
        if j < i or ends[j] - t[i] <= least:
            continue
        taken[i : j + 1] = True
        chosen.append((int(i), j))
    return sorted(chosen)
