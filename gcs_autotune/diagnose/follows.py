"""Which of two columns answers to the other: how much of one a first-order lag of the other accounts for."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.slow_imports import scipy_signal
from gcs_autotune.trial import Channel

__all__ = ["follows", "held_share", "on_grid"]

Array = NDArray[np.float64]

GRID = 2000
"""Samples of the common grid, at most."""

LAGS = np.geomspace(0.3, 300.0, 13)
"""Time constants tried, in steps of the grid."""


def on_grid(*channels: Channel) -> tuple[float, list[Array]] | None:
    """Return a common step [s] and all channels held on it where they overlap; None when they hardly do."""
    if any(len(c) < 2 for c in channels):
        return None
    start, end = max(float(c.t[0]) for c in channels), min(float(c.t[-1]) for c in channels)
    step = max(min(float(np.median(np.diff(c.t))) for c in channels), (end - start) / GRID)
    if not (end > start and step > 0.0) or (end - start) / step < 3 * len(LAGS):
        return None
    t = np.arange(start, end, step)
    return step, [c.values[np.searchsorted(c.t, t, side="right") - 1] for c in channels]


def follows(follower: Array, leader: Array, *, integrated: bool = False) -> float:
    """Return the share of *follower*'s variance (n,) that the best first-order lag of *leader* (n,) accounts for.

    Gain, offset and initial state are free, and what these account for without the leader does not count;
    *integrated*: the follower is the integral of such a lag (a position).
    """
    best = 0.0
    n = len(follower)
    index = np.arange(n)
    for lag in LAGS:
        a = math.exp(-1.0 / lag)
        lagged = scipy_signal().lfilter([0.0, 1.0 - a], [1.0, -a], leader)
        own = [np.ones(n), a**index, index / n] if integrated else [np.ones(n), a**index]
        without = _left(np.column_stack(own), follower)
        if without > 1e-18 * float(follower @ follower):
            left = _left(np.column_stack([*own, np.cumsum(lagged) if integrated else lagged]), follower)
            best = max(best, 1.0 - left / without)
    return best


def _left(table: Array, y: Array) -> float:
    """Return the sum of squares of *y* (n,) that the columns of *table* (n, k) leave."""
    norms = np.linalg.norm(table, axis=0)
    Q, R = np.linalg.qr(table[:, norms > 0.0] / norms[norms > 0.0])
    Q = Q[:, np.abs(np.diag(R)) > 1e-9]
    left = y - Q @ (Q.T @ y)
    return float(left @ left)


def held_share(values: Array) -> float:
    """Return the share of samples (n,) that repeat the one before exactly, as a command between its changes does."""
    return float(np.mean(np.diff(values) == 0.0)) if len(values) > 1 else 0.0
