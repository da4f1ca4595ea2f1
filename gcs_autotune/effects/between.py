"""Motion of an actuator between stamps, as values held on pieces short enough that a craft hardly notices.

A craft of time constant ``tau`` sees a motion of slope ``s``, held at its mean over a piece of length ``H``, wrong by
at most ``s H**2 / (8 tau)``. So pieces are as long as ``s H**2`` stays below ``resolution``; their mean is exact, and
so the impulse. Where the motion has settled no stamp is added. Pieces are counted from each stamp on and the last
one ends at the next, so every stamp and value moves continuously with the parameters: differences by them are smooth.

All functions return stamps and values (k,), each value held from its stamp on.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

__all__ = ["fading", "following", "limited"]

Array = NDArray[np.float64]

SETTLED = 20.0
"""After so many time constants a lag has caught up."""


@njit(cache=True)
def following(t: Array, u: Array, time_constant: float, resolution: float) -> tuple[Array, Array]:
    """Return the first-order lag of held commands *u* (n,) at *t* (n,), starting at the first.

    After a stamp the distance ``d`` to the command fades as ``exp(-s / T)``; pieces end where
    ``2 sqrt(|d| T / resolution) (1 - exp(-s / 2T))``, the number of pieces the slope asks for, is whole.
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
    """Return held commands *u* (n,) at *t* (n,) approached no faster than *rate*, starting at the first."""
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
    """Return held commands *u* (n,) at *t* (n,) times ``max(1 - rate (t - start), floor)``, drawn up to *end*."""
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
