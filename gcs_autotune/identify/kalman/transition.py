"""The compiled step of every filter: from one stamp to the next, with inputs that jump in between.

Linearisation (:func:`step`) propagates the mean by the Runge-Kutta steps of :mod:`gcs_autotune.models.coupled.kernel`.
The sensitivities of these steps are the transition matrix. The matrix is exact to rounding for the computed motion.

Sigma points (:func:`sigma_step`) are central differences at sqrt(3) standard deviations, Norgaard2000. Their covariance
is a sum of squares and stays positive with twenty parameters. The weights of the plain unscented transform would make
it negative.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from gcs_autotune.models import Program, Scratch, carry

__all__ = ["inertia", "measure", "sigma_step", "step"]

Array = NDArray[np.float64]
Index = NDArray[np.int64]

SHORT = 0.3
"""Product of interval and fastest rate below which a series gives the root of a transition. Its error is 3e-4."""


MAX_STEPS = 400.0
"""Maximum number of Runge-Kutta steps between two stamps. A model that needs more counts as too stiff."""


@njit(cache=True)
def inertia(P: Program, theta: Array, M: Array, M_inverse: Array) -> bool:
    """Fill M (6, 6) and the inverse (k, k) of its active part; return whether M is positive definite.

    Gauss-Jordan elimination needs no pivoting here. The pivots of a matrix with a positive definite symmetric part are
    positive.
    """
    k = len(P.active)
    M[:, :] = 0.0
    for e in range(len(P.inertia_coefs)):
        par = P.inertia[e, 2]
        M[P.inertia[e, 0], P.inertia[e, 1]] += P.inertia_coefs[e] * (theta[par] if par >= 0 else 1.0)
    work = np.zeros((k, 2 * k))
    for i in range(k):
        for j in range(k):
            work[i, j] = M[P.active[i], P.active[j]]
        work[i, k + i] = 1.0
    positive = True
    for i in range(k):
        pivot = work[i, i]
        if pivot <= 0.0:
            positive = False
            if abs(pivot) < 1e-9:
                pivot = -1e-9
        for j in range(2 * k):
            work[i, j] /= pivot
        for o in range(k):
            if o != i and work[o, i] != 0.0:
                factor = work[o, i]
                for j in range(2 * k):
                    work[o, j] -= factor * work[i, j]
    for i in range(k):
        for j in range(k):
            M_inverse[i, j] = work[i, k + j]
    return positive


@njit(cache=True)
def measure(P: Program, theta: Array, x: Array, code: int, free: Index, H: Array) -> float:
    """Return one output, and fill *H* (N,) with its derivatives by the states, then by the free parameters.

    code : index of the output. 0 to 5 are velocities over ground, 6 to 11 positions. free : (p,) column of each
        parameter in *H*, -1 if it is known.
    """
    H[:] = 0.0
    column = P.column[code]
    H[column] = 1.0
    value = x[column]
    if code > 1 or (P.current_x < 0 and P.current_y < 0):
        return float(value)
    heading = P.column[11]
    psi = x[heading] if heading >= 0 else 0.0
    c, s = np.cos(psi), np.sin(psi)
    north, east = (c, s) if code == 0 else (-s, c)
    turn_north, turn_east = (-s, c) if code == 0 else (-c, -s)
    for par, share, slope in ((P.current_x, north, turn_north), (P.current_y, east, turn_east)):
        if par >= 0:
            value += theta[par] * share
            if heading >= 0:
                H[heading] += theta[par] * slope
            if free[par] >= 0:
                H[free[par]] += share
    return float(value)


@njit(cache=True)
def step(
    P: Program,
    theta: Array,
    M: Array,
    M_inverse: Array,
    x: Array,
    F: Array,
    late: Array,
    t: float,
    stop: float,
    row: int,
    t_in: Array,
    inputs: Array,
    free: Index,
    max_rate: float,
    W: Scratch,
) -> tuple[bool, float, int]:
    """Propagate *x* over one interval in place, and fill its transitions ``F`` (n, N) and ``late`` (n, n).

    ``F`` is the transition of the whole interval, ``late`` that of its second half. Simpson's rule for the process
    noise needs ``late``. If the interval is short compared with the fastest rate, ``late`` is the root of the whole
    transition, from its series. A longer interval is computed in two halves.

    Returns
    -------
    Whether the motion stayed finite, the fastest rate [1/s], and the row of the input in force at *stop*.
    """
    n, N = F.shape
    begin, first = x.copy(), row
    F[:, :] = 0.0
    for i in range(n):
        F[i, i] = 1.0
    finite, rate, row, _ = carry(P, theta, M, M_inverse, x, F, t, stop, row, t_in, inputs, free, max_rate, MAX_STEPS, W)
    if not finite:
        return False, rate, row
    if rate * (stop - t) < SHORT:
        D = F[:, :n].copy()
        for i in range(n):
            D[i, i] -= 1.0
        square = np.dot(D, D)
        cube = np.dot(square, D)
        for i in range(n):
            for j in range(n):
                late[i, j] = 0.5 * D[i, j] - 0.125 * square[i, j] + 0.0625 * cube[i, j] + (1.0 if i == j else 0.0)
        return True, rate, row
    middle, fastest, row = 0.5 * (t + stop), 0.0, first
    early, second = np.zeros((n, N)), np.zeros((n, N))
    for i in range(n):
        x[i] = begin[i]
        early[i, i] = 1.0
        second[i, i] = 1.0
    for half in range(2):
        S, begins, ends = (early, t, middle) if half == 0 else (second, middle, stop)
        finite, rate, row, _ = carry(
            P, theta, M, M_inverse, x, S, begins, ends, row, t_in, inputs, free, max_rate, MAX_STEPS, W
        )
        fastest = max(fastest, rate)
        if not finite:
            return False, fastest, row
    for i in range(n):
        for j in range(n):
            late[i, j] = second[i, j]
    whole = np.dot(late, early)
    for i in range(n):
        for j in range(N):
            F[i, j] = whole[i, j] + (second[i, j] if j >= n else 0.0)
    return True, fastest, row


SPREAD_2 = 3.0
"""Squared distance of the sigma points, in standard deviations. The value 3 is best for a Gaussian (Norgaard2000)."""


@njit(cache=True)
def _root(cov: Array) -> Array:
    """Return the lower triangular L (N, N) with L L' = cov.

    Columns of directions without variance are zero.
    """
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
    """Propagate *mean* and *cov* from *t* to *stop* by sigma points, and update *x* (n,).

    On entry *x* is the mean propagated by linearisation; on return it is the better estimate. The function returns
    False and changes nothing if a sigma point diverges or has no positive inertia. The caller then uses the linearised
    step.
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
    for i in range(n):
        x[i] = better[i]
    return True
