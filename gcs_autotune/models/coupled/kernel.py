"""The compiled heart of :mod:`gcs_autotune.models.coupled`: right-hand side, its derivatives, and the sweep.

``M nu_dot + C(nu) nu = F(nu, eta, inputs)``, ``eta_dot = J(eta) nu + current``, with ``F`` a sum of products
``theta_p * c * f_1 * f_2 * f_3``. ``M`` is linear in the parameters; ``C`` follows from it (Fossen 2011, (3.46) for
the symmetric ``M``), so that ``C(nu) nu = [nu_2 x a; nu_1 x a + nu_2 x b]`` with momenta ``(a, b) = M nu``.

The sweep is classical Runge-Kutta of order four, with steps that end at every input jump and output stamp and are
short against the fastest rate; the sensitivities are carried through the same stages, so they are those of the
computed motion to rounding.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

__all__ = [
    "ETA",
    "INPUT",
    "INPUT_SIZE",
    "NU",
    "NU_SIZE",
    "SIN_PHI",
    "SIN_THETA",
    "Program",
    "advance",
    "evaluate",
    "sweep",
]

Array = NDArray[np.float64]
Index = NDArray[np.int64]

NU, NU_SIZE, ETA, SIN_PHI, SIN_THETA, INPUT, INPUT_SIZE = 0, 6, 12, 18, 19, 30, 60
"""Codes of factors: velocity j, its magnitude, position j (x y z phi theta psi), sines, input i, its magnitude."""

REACH = 0.25
"""Longest step times the fastest rate. Chosen: a Runge-Kutta step then errs by REACH**5/120 = 8e-6 of its change."""

RUNAWAY = 1e6
"""State at which a simulation is given up."""

MAX_STEPS = 400
"""Steps per interval between stamps before a simulation is given up as hopelessly stiff."""


class Program(NamedTuple):
    """A form as arrays. ``active`` (k,) degrees of freedom; ``column`` (12,) place of eta and nu in the state, -1
    if absent; ``rows``, ``pars``, ``coefs``, ``factors`` (T,), (T,), (T,), (T, 3) the terms (-1: no parameter, no
    factor); ``inertia`` (E, 3) row, column, parameter of each entry of M and ``inertia_coefs`` (E,); parameter
    indices of delay, lag and current, -1 if absent; ``m`` inputs.
    """

    active: Index
    column: Index
    rows: Index
    pars: Index
    coefs: Array
    factors: Index
    inertia: Index
    inertia_coefs: Array
    delay: int
    lag: int
    current_x: int
    current_y: int
    coriolis: int
    spatial: int
    m: int


@njit(cache=True)
def _cross(momentum: Array, nu: Array, out: Array) -> None:
    """Add ``[nu_2 x a; nu_1 x a + nu_2 x b]`` to *out* (6,)."""
    a0, a1, a2, b0, b1, b2 = momentum[0], momentum[1], momentum[2], momentum[3], momentum[4], momentum[5]
    u, v, w, p, q, r = nu[0], nu[1], nu[2], nu[3], nu[4], nu[5]
    out[0] += q * a2 - r * a1
    out[1] += r * a0 - p * a2
    out[2] += p * a1 - q * a0
    out[3] += v * a2 - w * a1 + q * b2 - r * b1
    out[4] += w * a0 - u * a2 + r * b0 - p * b2
    out[5] += u * a1 - v * a0 + p * b1 - q * b0


@njit(cache=True)
def _kinematics(P: Program, theta: Array, full: Array, deriv: bool, f: Array, A: Array) -> None:
    """Fill the eta rows of *f* and *A*; ``full`` (12,) is nu, then eta."""
    k = len(P.active)
    vx = theta[P.current_x] if P.current_x >= 0 else 0.0
    vy = theta[P.current_y] if P.current_y >= 0 else 0.0
    u, v, w, q, r = full[0], full[1], full[2], full[4], full[5]
    phi, tht, psi = full[9], full[10], full[11]
    cs, sn = np.cos(psi), np.sin(psi)
    if P.spatial == 0:
        for i in range(k):
            d = P.active[i]
            cu, cv, cr, cpsi = P.column[0], P.column[1], P.column[5], P.column[11]
            if d == 0:
                f[i] = u * cs - v * sn + vx
                if deriv:
                    if cu >= 0:
                        A[i, cu] = cs
                    if cv >= 0:
                        A[i, cv] = -sn
                    if cpsi >= 0:
                        A[i, cpsi] = -u * sn - v * cs
            elif d == 1:
                f[i] = u * sn + v * cs + vy
                if deriv:
                    if cu >= 0:
                        A[i, cu] = sn
                    if cv >= 0:
                        A[i, cv] = cs
                    if cpsi >= 0:
                        A[i, cpsi] = u * cs - v * sn
            elif d == 5:
                f[i] = r
                if deriv and cr >= 0:
                    A[i, cr] = 1.0
            else:
                f[i] = full[d]
                if deriv:
                    A[i, P.column[d]] = 1.0
        return
    cp, sp, ct, st = np.cos(phi), np.sin(phi), np.cos(tht), np.sin(tht)
    R = np.empty((3, 3))
    R[0, 0], R[0, 1], R[0, 2] = cs * ct, -sn * cp + cs * st * sp, sn * sp + cs * cp * st
    R[1, 0], R[1, 1], R[1, 2] = sn * ct, cs * cp + sp * st * sn, -cs * sp + st * sn * cp
    R[2, 0], R[2, 1], R[2, 2] = -st, ct * sp, ct * cp
    T = np.zeros((3, 3))
    T[0, 0], T[0, 1], T[0, 2] = 1.0, sp * st / ct, cp * st / ct
    T[1, 1], T[1, 2] = cp, -sp
    T[2, 1], T[2, 2] = sp / ct, cp / ct
    out = np.zeros(6)
    for i in range(3):
        for j in range(3):
            out[i] += R[i, j] * full[j]
            out[3 + i] += T[i, j] * full[3 + j]
    out[0] += vx
    out[1] += vy
    for i in range(k):
        f[i] = out[P.active[i]]
    if not deriv:
        return
    by = np.zeros((6, 3))  # derivatives by phi, theta, psi
    by[0, 0] = (sn * sp + cs * st * cp) * v + (sn * cp - cs * sp * st) * w
    by[1, 0] = (-cs * sp + cp * st * sn) * v + (-cs * cp - st * sn * sp) * w
    by[2, 0] = ct * cp * v - ct * sp * w
    by[0, 1] = -cs * st * u + cs * ct * sp * v + cs * cp * ct * w
    by[1, 1] = -sn * st * u + sp * ct * sn * v + ct * sn * cp * w
    by[2, 1] = -ct * u - st * sp * v - st * cp * w
    by[0, 2] = -(out[1] - vy)
    by[1, 2] = out[0] - vx
    by[3, 0] = (cp * q - sp * r) * st / ct
    by[3, 1] = (sp * q + cp * r) / (ct * ct)
    by[4, 0] = -sp * q - cp * r
    by[5, 0] = (cp * q - sp * r) / ct
    by[5, 1] = (sp * q + cp * r) * st / (ct * ct)
    for i in range(k):
        d = P.active[i]
        for j in range(3):
            c = P.column[j if d < 3 else 3 + j]
            if c >= 0:
                A[i, c] = R[d, j] if d < 3 else T[d - 3, j]
            c = P.column[9 + j]
            if c >= 0:
                A[i, c] = by[d, j]


@njit(cache=True)
def _factor(P: Program, code: int, full: Array, u: Array, lagged: Array) -> tuple[float, float, int]:
    """Return value, derivative and state column (-1: none) of one factor."""
    if code < 6:
        return full[code], 1.0, P.column[code]
    if code < 12:
        x = full[code - 6]
        return abs(x), (1.0 if x >= 0.0 else -1.0), P.column[code - 6]
    if code < 18:
        return full[code - 6], 1.0, P.column[code - 6]
    if code == 18:
        return np.sin(full[9]), np.cos(full[9]), P.column[9]
    if code == 19:
        return np.sin(full[10]), np.cos(full[10]), P.column[10]
    i = code - 60 if code >= 60 else code - 30
    column = -1
    x = u[i]
    if P.lag >= 0:
        x = lagged[i]
        column = 2 * len(P.active) + i
    if code >= 60:
        return abs(x), (1.0 if x >= 0.0 else -1.0), column
    return x, 1.0, column


@njit(cache=True)
def evaluate(
    P: Program,
    theta: Array,
    M: Array,
    M_inverse: Array,
    x: Array,
    u: Array,
    free: Index,
    deriv: bool,
    f: Array,
    A: Array,
    B: Array,
) -> None:
    """Compute the state's rate *f* (n,), and with *deriv* its derivatives ``A`` (n, n) and ``B`` (n, q).

    M : (6, 6); M_inverse : (k, k) of its active part. free : (p,) column of ``B`` per parameter, -1 if not wanted.
    The column of the delay stays zero: a delay acts at the jumps only.
    """
    k = len(P.active)
    n = len(x)
    full = np.zeros(12)
    for j in range(12):
        if P.column[j] >= 0:
            full[j] = x[P.column[j]]
    lagged = x[2 * k :]
    if deriv:
        A[:, :] = 0.0
        B[:, :] = 0.0
    _kinematics(P, theta, full, deriv, f, A)
    if deriv:
        for i in range(k):
            if P.active[i] == 0 and P.current_x >= 0 and free[P.current_x] >= 0:
                B[i, free[P.current_x]] = 1.0
            if P.active[i] == 1 and P.current_y >= 0 and free[P.current_y] >= 0:
                B[i, free[P.current_y]] = 1.0
    force = np.zeros(6)
    by_x = np.zeros((6, n if deriv else 1))
    by_p = np.zeros((6, B.shape[1] if deriv else 1))
    nu = full[:6]
    for t in range(len(P.rows)):
        row, par = P.rows[t], P.pars[t]
        weight = P.coefs[t] * (theta[par] if par >= 0 else 1.0)
        product = 1.0
        for s in range(3):
            if P.factors[t, s] >= 0:
                product *= _factor(P, P.factors[t, s], full, u, lagged)[0]
        force[row] += weight * product
        if deriv:
            if par >= 0 and free[par] >= 0:
                by_p[row, free[par]] += P.coefs[t] * product
            for s in range(3):
                if P.factors[t, s] < 0:
                    continue
                _, slope, column = _factor(P, P.factors[t, s], full, u, lagged)
                if column < 0:
                    continue
                rest = weight * slope
                for o in range(3):
                    if o != s and P.factors[t, o] >= 0:
                        rest *= _factor(P, P.factors[t, o], full, u, lagged)[0]
                by_x[row, column] += rest
    momentum = np.zeros(6)
    if P.coriolis == 1:
        for i in range(6):
            for j in range(6):
                momentum[i] += M[i, j] * nu[j]
        c = np.zeros(6)
        _cross(momentum, nu, c)
        for i in range(6):
            force[i] -= c[i]
        if deriv:
            unit = np.zeros(6)
            for j in range(6):
                if P.column[j] < 0:
                    continue
                c[:] = 0.0
                unit[j] = 1.0
                _cross(M[:, j].copy(), nu, c)
                _cross(momentum, unit, c)
                unit[j] = 0.0
                for i in range(6):
                    by_x[i, P.column[j]] -= c[i]
    for i in range(k):
        rate = 0.0
        for j in range(k):
            rate += M_inverse[i, j] * force[P.active[j]]
        f[k + i] = rate
    if P.lag >= 0:
        T = theta[P.lag]
        for i in range(P.m):
            f[2 * k + i] = (u[i] - lagged[i]) / T
    if not deriv:
        return
    for e in range(len(P.inertia_coefs)):
        row, col, par = P.inertia[e, 0], P.inertia[e, 1], P.inertia[e, 2]
        if par < 0 or free[par] < 0:
            continue
        q, weight = free[par], P.inertia_coefs[e]
        place = P.column[col]
        if place >= 0:
            by_p[row, q] -= weight * f[place]
        if P.coriolis == 1:
            momentum[:] = 0.0
            momentum[row] = weight * nu[col]
            c = np.zeros(6)
            _cross(momentum, nu, c)
            for i in range(6):
                by_p[i, q] -= c[i]
    for i in range(k):
        for j in range(k):
            g = M_inverse[i, j]
            if g == 0.0:
                continue
            d = P.active[j]
            for c_ in range(n):
                A[k + i, c_] += g * by_x[d, c_]
            for c_ in range(B.shape[1]):
                B[k + i, c_] += g * by_p[d, c_]
    if P.lag >= 0:
        T = theta[P.lag]
        for i in range(P.m):
            A[2 * k + i, 2 * k + i] = -1.0 / T
            if free[P.lag] >= 0:
                B[2 * k + i, free[P.lag]] = -f[2 * k + i] / T


@njit(cache=True)
def _rate(A: Array) -> float:
    """Return a measure of the fastest rate [1/s] that does not depend on the units of the states."""
    largest = 0.0
    for i in range(A.shape[0]):
        total = 0.0
        for j in range(A.shape[1]):
            total += np.sqrt(abs(A[i, j] * A[j, i]))
        largest = max(largest, total)
    return largest


@njit(cache=True)
def advance(
    P: Program,
    theta: Array,
    M: Array,
    M_inverse: Array,
    x: Array,
    S: Array,
    u: Array,
    free: Index,
    span: float,
    deriv: bool,
    pace: float,
    f: Array,
    A: Array,
    B: Array,
) -> float:
    """Advance state and sensitivities by *span*; return the fastest rate met, negative when it ran away."""
    n, q = S.shape
    steps = int(np.ceil(span * pace / REACH))
    if steps < 1:
        steps = 1
    if steps > MAX_STEPS:
        return -1.0
    h = span / steps
    kx = np.zeros((4, n))
    ks = np.zeros((4, n, q)) if deriv else np.zeros((1, 1, 1))
    y = np.empty(n)
    Y = np.empty((n, q))
    fastest = 0.0
    for _ in range(steps):
        for stage in range(4):
            c = 0.0 if stage == 0 else (1.0 if stage == 3 else 0.5)
            for i in range(n):
                y[i] = x[i] + (c * h * kx[stage - 1, i] if stage > 0 else 0.0)
            evaluate(P, theta, M, M_inverse, y, u, free, deriv, f, A, B)
            for i in range(n):
                kx[stage, i] = f[i]
            if deriv:
                if stage == 0:
                    fastest = max(fastest, _rate(A))
                for i in range(n):
                    for j in range(q):
                        Y[i, j] = S[i, j] + (c * h * ks[stage - 1, i, j] if stage > 0 else 0.0)
                for i in range(n):
                    for j in range(q):
                        ks[stage, i, j] = B[i, j]
                    for o in range(n):
                        a = A[i, o]
                        if a != 0.0:
                            for j in range(q):
                                ks[stage, i, j] += a * Y[o, j]
        for i in range(n):
            x[i] += h / 6.0 * (kx[0, i] + 2.0 * kx[1, i] + 2.0 * kx[2, i] + kx[3, i])
            if not abs(x[i]) < RUNAWAY:
                return -1.0
            if deriv:
                for j in range(q):
                    S[i, j] += h / 6.0 * (ks[0, i, j] + 2.0 * ks[1, i, j] + 2.0 * ks[2, i, j] + ks[3, i, j])
    return fastest


@njit(cache=True, nogil=True)
def sweep(
    P: Program,
    theta: Array,
    M: Array,
    M_inverse: Array,
    x_0: Array,
    t_in: Array,
    inputs: Array,
    t_out: Array,
    free: Index,
    state_column: Index,
    q: int,
    deriv: bool,
    pace: float,
    X: Array,
    S_out: Array,
) -> float:
    """Simulate from ``x_0`` at ``t_out[0]``; fill ``X`` (s, n) and with *deriv* ``S_out`` (s, n, q).

    inputs : (j, m), each row from its stamp ``t_in`` (plus the delay) on, the first also before it. state_column :
    (n,) column of the sensitivity to each initial state, -1 if it is known. pace : fastest rate [1/s] expected.
    Returns the fastest rate met (0 without derivatives), -1 when the motion ran away.
    """
    n = len(x_0)
    x = x_0.copy()
    S = np.zeros((n, q))
    for i in range(n):
        if state_column[i] >= 0:
            S[i, state_column[i]] = 1.0
    f, A, B = np.zeros(n), np.zeros((n, n)), np.zeros((n, q))
    before = np.zeros(n)
    delay = theta[P.delay] if P.delay >= 0 else 0.0
    delay_column = free[P.delay] if P.delay >= 0 else -1
    t, j, fastest = t_out[0], 0, 0.0
    while j + 1 < len(t_in) and t_in[j + 1] + delay <= t:
        j += 1
    for s in range(len(t_out)):
        while t < t_out[s]:
            jump = j + 1 < len(t_in) and t_in[j + 1] + delay <= t_out[s]
            stop = t_in[j + 1] + delay if jump else t_out[s]
            if stop > t:
                rate = advance(P, theta, M, M_inverse, x, S, inputs[j], free, stop - t, deriv, pace, f, A, B)
                if rate < 0.0:
                    return -1.0
                fastest = max(fastest, rate)
                t = stop
            if jump:
                if deriv and delay_column >= 0:
                    evaluate(P, theta, M, M_inverse, x, inputs[j], free, False, before, A, B)
                    evaluate(P, theta, M, M_inverse, x, inputs[j + 1], free, False, f, A, B)
                    for i in range(n):
                        S[i, delay_column] += before[i] - f[i]
                j += 1
        for i in range(n):
            X[s, i] = x[i]
            if deriv:
                for c in range(q):
                    S_out[s, i, c] = S[i, c]
    return fastest
