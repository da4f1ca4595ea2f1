"""The compiled step of every filter here: from one stamp to the next, with inputs that jump on the way.

The mean is carried by the Runge-Kutta steps of :mod:`gcs_autotune.models.coupled.kernel`, the transition matrix by the
sensitivities of the same steps, so it is that of the computed motion to rounding.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from gcs_autotune.models import Program, Scratch, carry

__all__ = ["MAX_STEPS", "inertia", "measure", "step"]

Array = NDArray[np.float64]
Index = NDArray[np.int64]

SHORT = 0.3
"""Interval times fastest rate below which the root of a transition is taken by its series; it then errs by 3e-4."""


MAX_STEPS = 400.0
"""Runge-Kutta steps between two stamps before a filter's model is given up as hopelessly stiff."""


@njit(cache=True)
def inertia(P: Program, theta: Array, M: Array, M_inverse: Array) -> bool:
    """Fill M (6, 6) and the inverse (k, k) of its active part; return whether it is positive definite.

    Gauss-Jordan without pivoting: the pivots of a matrix with a positive definite symmetric part are positive.
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
    """Return one output and fill its derivatives *H* (N,) by states, then free parameters.

    code : 0-5 velocity over ground, 6-11 position. free : (p,) column of each parameter in *H*, -1 if it is known.
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
    """Carry *x* over one interval; fill ``F`` (n, N) of the whole and ``late`` (n, n) of its second half.

    Returns whether the motion stayed finite, the fastest rate met and the input row in force at *stop*.

    ``late`` is what process noise needs (Simpson's rule). Over an interval short against the fastest rate it is the
    root of the whole's, by its series; over a longer one the interval is crossed in two halves.
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
    x[:] = begin
    middle = 0.5 * (t + stop)
    early, second = np.zeros((n, N)), np.zeros((n, N))
    for i in range(n):
        early[i, i] = 1.0
        second[i, i] = 1.0
    finite, before, row, _ = carry(
        P, theta, M, M_inverse, x, early, t, middle, first, t_in, inputs, free, max_rate, MAX_STEPS, W
    )
    if not finite:
        return False, before, row
    finite, rate, row, _ = carry(
        P, theta, M, M_inverse, x, second, middle, stop, row, t_in, inputs, free, max_rate, MAX_STEPS, W
    )
    late[:, :] = second[:, :n]
    F[:, :] = np.dot(late, early)
    F[:, n:] += second[:, n:]
    return finite, max(before, rate), row
