"""What a sampled motion was a moment ago: interpolation that does not ring at the kinks commands leave.

A velocity has a kink wherever its command jumps, mostly at a stamp. In each interval the three cubics through four
neighbouring samples are mixed by how smooth they are, as weighted essentially non-oscillatory schemes do (Liu1994):
away from kinks the error is of fourth order, and next to one the cubic that does not cross it counts.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

__all__ = ["earlier"]

Array = NDArray[np.float64]

CLOSE = 0.3
"""Stamps nearer than this share of the median interval are passed over: a cubic through them magnifies rounding."""


def earlier(t: Array, y: Array, delay: float, *, coasting: bool) -> Array:
    """Return *y* (s,), known at stamps *t* (s,) [s], as it was *delay* >= 0 [s] before each.

    Before the first stamp the motion is not known: a position (*coasting*) goes on as it began, a velocity holds.
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
    """Return the cubic through four samples from *first* on at *x*, and its third divided difference."""
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
    swing = y.max() - y.min()
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
        floor = (1e-7 * swing / (h * h * h)) ** 2 + 1e-100
        total, weights = 0.0, 0.0
        for first in range(max(i - 2, 0), min(i, n - 4) + 1):
            value, third = _cubic(t, y, first, x)
            weight = 1.0 / (third * third + floor) ** 2 if third * third + floor < 1e70 else 1e-140
            total += weight * value
            weights += weight
        out[k] = total / weights
    return out
