"""The compiled step of every filter here: from one stamp to the next, with inputs that jump on the way.

The mean is carried by the Runge-Kutta steps of :mod:`gcs_autotune.models.coupled.kernel`, the transition matrix by the
sensitivities of the same steps, so it is that of the computed motion to rounding.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from gcs_autotune.models import REACH, Program, advance, scratch

__all__ = ["carry", "inertia", "measure", "step"]

Array = NDArray[np.float64]
Index = NDArray[np.int64]

SHORT = 0.3
"""Interval times fastest rate below which the root of a transition is taken by its series; it then errs by 3e-4."""


MAX_STEPS = 400
"""Steps between two stamps before a filter's model is given up as hopelessly stiff."""


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
def carry(
    P: Program,
    theta: Array,
    M: Array,
    M_inverse: Array,
    x: Array,
    S: Array,
    t: float,
    stop: float,
    row: int,
    t_in: Array,
    inputs: Array,
    free: Index,
    deriv: bool,
    pace: float,
) -> tuple[float, int]:
    """Carry state *x* (n,) and sensitivities *S* (n, q) from *t* to *stop* through the jumps of the inputs.

    pace : fastest rate [1/s] steps are made for. Returns the fastest rate met (negative: it ran away) and the input
    row in force at *stop*.
    """
    n, q = S.shape
    f, A, B, before = np.zeros(n), np.zeros((n, n)), np.zeros((n, q)), np.zeros(n)
    kx, ks, y, Y = np.zeros((4, n)), np.zeros((4, n, q)), np.zeros(n), np.zeros((n, q))
    W = scratch(n, q)
    delay = theta[P.delay] if P.delay >= 0 else 0.0
    column = free[P.delay] if P.delay >= 0 else -1
    fastest, plain = 0.0, not deriv  # false where it is used; a literal would be compiled for on its own
    while t < stop:
        jump = row + 1 < len(t_in) and t_in[row + 1] + delay <= stop
        until = t_in[row + 1] + delay if jump else stop
        if until > t:
            span, held = until - t, inputs[row]
            if span * pace > MAX_STEPS * REACH:
                return -1.0, row
            finite, rate = advance(
                P, theta, M, M_inverse, x, S, held, free, span, deriv, pace, f, A, B, kx, ks, y, Y, W
            )
            if not finite:
                return -1.0, row
            fastest = max(fastest, rate)
            t = until
        if jump:
            if deriv and column >= 0:
                old, new = inputs[row], inputs[row + 1]
                advance(P, theta, M, M_inverse, x, S, old, free, 0.0, plain, pace, before, A, B, kx, ks, y, Y, W)
                advance(P, theta, M, M_inverse, x, S, new, free, 0.0, plain, pace, f, A, B, kx, ks, y, Y, W)
                for i in range(n):
                    S[i, column] += before[i] - f[i]
            row += 1
    return fastest, row


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
    pace: float,
) -> tuple[float, int]:
    """Carry *x* over one interval; fill ``F`` (n, N) of the whole and ``late`` (n, n) of its second half.

    ``late`` is what process noise needs (Simpson's rule). Over an interval short against the fastest rate it is the
    root of the whole's, by its series; over a longer one the interval is crossed in two halves.
    """
    n, N = F.shape
    begin, first = x.copy(), row
    F[:, :] = 0.0
    for i in range(n):
        F[i, i] = 1.0
    rate, row = carry(P, theta, M, M_inverse, x, F, t, stop, row, t_in, inputs, free, True, pace)
    if rate < 0.0:
        return rate, row
    if rate * (stop - t) < SHORT:
        D = F[:, :n].copy()
        for i in range(n):
            D[i, i] -= 1.0
        square = np.dot(D, D)
        cube = np.dot(square, D)
        for i in range(n):
            for j in range(n):
                late[i, j] = 0.5 * D[i, j] - 0.125 * square[i, j] + 0.0625 * cube[i, j] + (1.0 if i == j else 0.0)
        return rate, row
    x[:] = begin
    middle = 0.5 * (t + stop)
    early, second = np.zeros((n, N)), np.zeros((n, N))
    for i in range(n):
        early[i, i] = 1.0
        second[i, i] = 1.0
    before, row = carry(P, theta, M, M_inverse, x, early, t, middle, first, t_in, inputs, free, True, pace)
    if before < 0.0:
        return before, row
    rate, row = carry(P, theta, M, M_inverse, x, second, middle, stop, row, t_in, inputs, free, True, pace)
    late[:, :] = second[:, :n]
    F[:, :] = np.dot(late, early)
    F[:, n:] += second[:, n:]
    return (max(before, rate) if rate >= 0.0 else rate), row
