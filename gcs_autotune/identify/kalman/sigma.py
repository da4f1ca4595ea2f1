"""Time update by sigma points: central differences at sqrt(3) standard deviations.

Norgaard2000: its
covariance is a sum of squares, so that twenty parameters do not make it negative as the weights of the plain unscented
transform would.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from gcs_autotune.identify.kalman.transition import MAX_STEPS, inertia
from gcs_autotune.models import Program, Scratch, carry

__all__ = ["sigma_step"]

Array = NDArray[np.float64]
Index = NDArray[np.int64]

SPREAD_2 = 3.0
"""Squared distance of the sigma points in standard deviations; 3 is best for a Gaussian (Norgaard et al.)."""


@njit(cache=True)
def _root(cov: Array) -> Array:
    """Return L (N, N), lower, with L L' = cov; columns of directions without variance are zero."""
    N = len(cov)
    L = np.zeros((N, N))
    for j in range(N):
        pivot = cov[j, j]
        for o in range(j):
            pivot -= L[j, o] * L[j, o]
        if pivot <= 1e-13 * cov[j, j]:
            continue
        L[j, j] = np.sqrt(pivot)
        for i in range(j + 1, N):
            value = cov[i, j]
            for o in range(j):
                value -= L[i, o] * L[j, o]
            L[i, j] = value / L[j, j]
    return L


@njit(cache=True)
def sigma_step(
    P: Program,
    theta: Array,
    places: Index,
    mean: Array,
    cov: Array,
    x: Array,
    F: Array,
    late: Array,
    q: Array,
    walk: Array,
    t: float,
    stop: float,
    row: int,
    t_in: Array,
    inputs: Array,
    max_rate: float,
    W: Scratch,
) -> bool:
    """Carry *mean*, *cov* from *t* to *stop*; *x* (n,) comes in as the mean carried plainly and goes out as the better.

    Returns False, with nothing changed, when a sigma point has no positive inertia or runs away: the caller then uses
    the linearised step.
    """
    n, N, p = len(x), len(mean), len(places)
    L = _root(cov)
    reach = np.sqrt(SPREAD_2)
    M, M_inverse = np.zeros((6, 6)), np.zeros((len(P.active), len(P.active)))
    other = theta.copy()
    empty = np.zeros((n, 0))
    known = np.full(len(theta), -1, dtype=np.int64)
    slope, bend = np.zeros((n, N)), np.zeros((n, N))
    better = x.copy()
    ends = np.zeros((2, n))
    for j in range(N):
        if L[j, j] == 0.0:
            continue
        for side in range(2):
            sign = reach if side == 0 else -reach
            for i in range(n):
                ends[side, i] = mean[i] + sign * L[i, j]
            for i in range(p):
                other[places[i]] = mean[n + i] + sign * L[n + i, j]
            if not inertia(P, other, M, M_inverse):
                return False
            end = ends[side]
            finite, _, _, _ = carry(
                P, other, M, M_inverse, end, empty, t, stop, row, t_in, inputs, known, max_rate, MAX_STEPS, W
            )
            if not finite:
                return False
        for i in range(n):
            slope[i, j] = (ends[0, i] - ends[1, i]) / (2.0 * reach)
            bend[i, j] = (ends[0, i] + ends[1, i] - 2.0 * x[i]) * np.sqrt(SPREAD_2 - 1.0) / (2.0 * SPREAD_2)
            better[i] += (ends[0, i] + ends[1, i] - 2.0 * x[i]) / (2.0 * SPREAD_2)
    h = stop - t
    top = np.dot(slope, np.ascontiguousarray(slope.T)) + np.dot(bend, np.ascontiguousarray(bend.T))
    cross = np.dot(slope, np.ascontiguousarray(L.T))
    for i in range(n):
        for j in range(n):
            value = top[i, j]
            for o in range(n):
                early = F[i, o] * F[j, o] + 4.0 * late[i, o] * late[j, o]
                value += q[o] * h / 6.0 * (early + (1.0 if i == o and j == o else 0.0))
            cov[i, j] = value
        for j in range(n, N):
            cov[i, j] = cross[i, j]
            cov[j, i] = cross[i, j]
    for i in range(n, N):
        cov[i, i] += walk[i - n] * h
    x[:] = better
    return True
