"""Compiled kernels of effects: actuators between stamps, backlash, and a sampled motion at an earlier time.

**Between stamps.** A motion with slope ``s`` is approximated by its mean over a piece of length ``H``. The response of
a craft of time constant ``tau`` then has an error of at most ``s H**2 / (8 tau)``. Pieces are therefore so short that
``s H**2`` is below ``resolution``. The mean of each piece is exact, and so is the impulse. After the motion has
settled, no stamp is added. Pieces are counted from each stamp, and the last one ends at the next stamp. Every stamp and
value therefore changes continuously with the parameters, and difference quotients are smooth. :func:`following`,
:func:`limited` and :func:`fading` return stamps and values (k,), each value held from its stamp on.

**At an earlier time.** A velocity has a kink where its command jumps, mostly at a stamp. In each interval, the three
cubics through four neighbouring samples are weighted by their smoothness. Weighted essentially non-oscillatory schemes
use the same method (Liu1994). Away from kinks the error is of fourth order. Near a kink, the cubic that does not cross
the kink has the largest weight.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

__all__ = ["SETTLED", "backlash", "earlier", "fading", "following", "limited"]

Array = NDArray[np.float64]


SETTLED = 20.0
"""Number of time constants after which a lag has settled. Project choice."""


@njit(cache=True)
def following(t: Array, u: Array, time_constant: float, resolution: float) -> tuple[Array, Array]:
    """Return stamps and values (k,) of a first-order lag of the commands *u* (n,), held from the stamps *t* (n,).

    The output starts at the first command. After a stamp the distance ``d`` to the command decays as ``exp(-s / T)``. A
    piece ends where the number of pieces so far, ``2 sqrt(|d| T / resolution) (1 - exp(-s / 2T))``, is an integer.
    """
    n, T = len(t), time_constant
    stamps, values = np.empty(0), np.empty(0)
    for fill in (False, True):
        count, y = 0, u[0]
        for j in range(n):
            d = y - u[j]
            h = t[j + 1] - t[j] if j + 1 < n else SETTLED * T
            pieces = 2.0 * np.sqrt(abs(d) * T / resolution)
            begin, m = 0.0, 1.0
            while True:
                end = min(-2.0 * T * np.log1p(-m / pieces), h) if m < pieces else h
                if fill:
                    span = (end - begin) / T
                    mean = -np.expm1(-span) / span if span > 0.0 else 1.0
                    stamps[count], values[count] = t[j] + begin, u[j] + d * np.exp(-begin / T) * mean
                count += 1
                if end >= h:
                    break
                begin, m = end, m + 1.0
            y = u[j] + d * np.exp(-h / T)
        if fill:
            stamps[count], values[count] = t[n - 1] + SETTLED * T, u[n - 1]
        else:
            stamps, values = np.empty(count + 1), np.empty(count + 1)
    return stamps, values


@njit(cache=True)
def limited(t: Array, u: Array, rate: float, resolution: float) -> tuple[Array, Array]:
    """Return stamps and values (k,) of the commands *u* (n,), held from the stamps *t* (n,) and limited to the rate
    *rate*.

    The output starts at the first command.
    """
    n = len(t)
    length = np.sqrt(resolution / rate)
    stamps, values = np.empty(0), np.empty(0)
    for fill in (False, True):
        count, y = 0, u[0]
        for j in range(n):
            d = u[j] - y
            h = t[j + 1] - t[j] if j + 1 < n else np.inf
            slope = rate if d > 0.0 else -rate
            reached = abs(d) / rate
            stop = min(reached, h)
            begin, m = 0.0, 1.0
            while begin < stop:
                end = min(m * length, stop)
                if fill:
                    stamps[count], values[count] = t[j] + begin, y + slope * 0.5 * (begin + end)
                count += 1
                begin, m = end, m + 1.0
            if reached < h:
                if fill:
                    stamps[count], values[count] = t[j] + reached, u[j]
                count += 1
                y = u[j]
            else:
                y += slope * h
        if not fill:
            stamps, values = np.empty(count), np.empty(count)
    return stamps, values


@njit(cache=True)
def _fade(s: float, rate: float, floor: float) -> float:
    """Return the integral from 0 to *s* of ``max(1 - rate s, floor)``."""
    if rate <= 0.0 or 1.0 - rate * s >= floor:
        return s - 0.5 * rate * s * s
    low = (1.0 - floor) / rate
    return low - 0.5 * rate * low * low + floor * (s - low)


@njit(cache=True)
def fading(
    t: Array, u: Array, start: float, end: float, rate: float, floor: float, resolution: float
) -> tuple[Array, Array]:
    """Return stamps and values (k,) of the held commands *u* (n,) times ``max(1 - rate (t - start), floor)``, up to
    *end*.
    """
    n = len(t)
    stamps, values = np.empty(0), np.empty(0)
    low = start + (1.0 - floor) / rate if rate > 0.0 else np.inf
    for fill in (False, True):
        count = 0
        for j in range(n):
            h = (t[j + 1] if j + 1 < n else max(end, t[j])) - t[j]
            slope = abs(u[j] * rate)
            length = np.sqrt(resolution / slope) if slope * h * h > resolution else h
            begin, m = 0.0, 1.0
            while True:
                stop = h if t[j] + begin >= low else min(m * length, h)
                if fill:
                    a, b = t[j] + begin - start, t[j] + stop - start
                    if b > a:
                        gain = (_fade(b, rate, floor) - _fade(a, rate, floor)) / (b - a)
                    else:
                        gain = max(1.0 - rate * a, floor)
                    stamps[count], values[count] = t[j] + begin, u[j] * gain
                count += 1
                if stop >= h:
                    break
                begin, m = stop, m + 1.0
        if not fill:
            stamps, values = np.empty(count), np.empty(count)
    return stamps, values


@njit(cache=True)
def backlash(u: Array, half: float) -> Array:
    """Return the output (n,) of a backlash of *half* in each direction for the commands *u* (n,).

    The output starts at the first command.
    """
    acting = np.empty(len(u))
    y = u[0]
    for i in range(len(u)):
        y = min(max(y, u[i] - half), u[i] + half)
        acting[i] = y
    return acting


CLOSE = 0.3
"""Distance of stamps, relative to the median interval, below which a stamp is skipped. Project choice.

A cubic through such close stamps would magnify rounding.
"""


def earlier(t: Array, y: Array, delay: float, *, coasting: bool) -> Array:
    """Return the values (s,) of *y* at the time *delay* before each of the stamps *t* (s,) [s].

    *y* (s,) is known at *t*, and *delay* [s] is 0 or more. Before the first stamp the motion is unknown. A position
    (*coasting*) is extrapolated linearly, a velocity is held.
    """
    nodes = _nodes(t)
    if len(nodes) < 4:
        return np.asarray(np.interp(t - delay, t[nodes], y[nodes]))
    return np.asarray(_earlier(t[nodes], y[nodes], t - delay, coasting))


def _nodes(t: Array) -> NDArray[np.intp]:
    gaps = np.diff(t)
    usual = CLOSE * float(np.median(gaps[gaps > 0.0])) if bool(np.any(gaps > 0.0)) else 0.0
    if len(gaps) and float(gaps.min()) >= usual > 0.0:
        return np.arange(len(t))
    kept = [0]
    for i in range(1, len(t)):
        if t[i] - t[kept[-1]] >= usual > 0.0:
            kept.append(i)
    return np.array(kept)


@njit(cache=True)
def _cubic(t: Array, y: Array, first: int, x: float) -> tuple[float, float]:
    """Return the value at *x* of the cubic through four samples from *first* on, and its third divided difference."""
    t0, t1, t2, t3 = t[first], t[first + 1], t[first + 2], t[first + 3]
    a, b, c = y[first], y[first + 1], y[first + 2]
    d01, d12, d23 = (b - a) / (t1 - t0), (c - b) / (t2 - t1), (y[first + 3] - c) / (t3 - t2)
    d012, d123 = (d12 - d01) / (t2 - t0), (d23 - d12) / (t3 - t1)
    d = (d123 - d012) / (t3 - t0)
    return a + (x - t0) * (d01 + (x - t1) * (d012 + (x - t2) * d)), d


@njit(cache=True)
def _earlier(t: Array, y: Array, at: Array, coasting: bool) -> Array:
    n = len(t)
    out = np.empty(len(at))
    h0, h1 = t[1] - t[0], t[2] - t[0]
    slope = ((y[1] - y[0]) * h1 / h0 - (y[2] - y[0]) * h0 / h1) / (h1 - h0) if coasting else 0.0
    span = y.max() - y.min()
    i = 0
    for k in range(len(at)):
        x = at[k]
        if x <= t[0]:
            out[k] = y[0] + slope * (x - t[0])
            continue
        while i < n - 2 and t[i + 1] < x:
            i += 1
        # Third differences this small are rounding, not kinks.
        h = t[i + 1] - t[i]
        floor = (1e-7 * span / (h * h * h)) ** 2 + 1e-100
        total, weights = 0.0, 0.0
        for first in range(max(i - 2, 0), min(i, n - 4) + 1):
            value, third = _cubic(t, y, first, x)
            weight = 1.0 / (third * third + floor) ** 2 if third * third + floor < 1e70 else 1e-140
            total += weight * value
            weights += weight
        out[k] = total / weights
    return out
