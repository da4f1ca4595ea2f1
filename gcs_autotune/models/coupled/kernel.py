"""The compiled core of :mod:`gcs_autotune.models.coupled`: right-hand side, its derivatives, and integration.

The equations are ``M nu_dot + C(nu) nu = F(nu, eta, inputs)``, ``eta_dot = J(eta) nu + current``. ``F`` is a sum of
products ``theta_p * theta_s * c * f_1 * f_2 * f_3`` (few terms have the second parameter ``theta_s``). ``M`` is linear
in the parameters. ``C`` follows from it (Fossen2011, (3.46) for the symmetric ``M``), so that
``C(nu) nu = [nu_2 x a; nu_1 x a + nu_2 x b]`` with momenta ``(a, b) = M nu``.

The integration is classical Runge-Kutta of order four. Steps end at every input jump and output stamp, and are short
relative to the fastest rate. The sensitivities are calculated in the same stages. They are therefore those of the
computed motion, to rounding.

All is in one file, because numba's cache does not detect a change of a function compiled into another file's. After a
change of this file, also clear ``__pycache__`` in ``identify/kalman``. Every function is compiled only once: no literal
numbers or booleans are passed to a compiled function, because numba would compile it again for each.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from gcs_autotune.jit import called, inlined, pasted

__all__ = [
    "COS_PSI",
    "ETA",
    "INPUT",
    "INPUT_SIZE",
    "NEAR",
    "NU",
    "NU_SIZE",
    "SIN_PHI",
    "SIN_PSI",
    "SIN_THETA",
    "Program",
    "carry",
    "evaluate",
    "scratch",
    "sweep",
]


Array = NDArray[np.float64]
Index = NDArray[np.int64]

NU, NU_SIZE, ETA, SIN_PHI, SIN_THETA, SIN_PSI, COS_PSI, NEAR, INPUT, INPUT_SIZE = 0, 6, 12, 18, 19, 20, 21, 22, 30, 60
"""Codes of the factors of a term, in the order of these names.

They are velocity j, its magnitude, and position j (x y z phi theta psi). Then follow sines and cosine, nearness to the
bottom ``exp((z - bottom) / reach)``, input i, and its magnitude.
"""

STEEPEST = 50.0
"""Largest exponent in the nearness to the bottom. Project choice.

A simulation below the bottom then diverges without overflow.
"""

REACH = 0.4
"""Longest Runge-Kutta step times the fastest rate.

Project choice: the error of a step is then REACH**5/120 = 9e-5 of its change.
"""

RUNAWAY = 1e6
"""Value of a state above which a simulation is abandoned. Project choice."""


# What is called for every stage is inlined: without passing a hundred words per call a simulation takes a quarter of
# the time. Where ``_advance`` is called and not inlined, it takes up to three times as long. Which of them are pasted
# was measured, each.


class Program(NamedTuple):
    """A form as arrays.

    - ``active`` (k,): indices of the degrees of freedom.
    - ``column`` (12,): indices of eta and nu in the state, -1 if absent.
    - ``rows``, ``pars``, ``scales``, ``coefs`` (T,), ``factors`` (T, 3): the terms (-1: no parameter, no second
      parameter, no factor).
    - ``inertia`` (E, 3): row, column and parameter of each element of M.
    - ``inertia_coefs`` (E,): coefficients of these elements.
    - ``payload`` (6,): index of the input that multiplies the inertia in each row, -1 if absent.
    - ``depth``: index of the input that replaces z, -1 if absent.
    - ``m``: number of inputs.

    Further fields are indices of parameters, -1 if absent. They are those of delay, lag, current, drift (a current not
    included in measured velocities), reach and bottom.
    """

    active: Index
    column: Index
    rows: Index
    pars: Index
    scales: Index
    coefs: Array
    factors: Index
    inertia: Index
    inertia_coefs: Array
    delay: int
    lag: int
    current_x: int
    current_y: int
    drift_x: int
    drift_y: int
    reach: int
    bottom: int
    payload: Index
    depth: int
    coriolis: int
    spatial: int
    m: int


@inlined
def _cross(momentum: Array, nu: Array, out: Array) -> None:
    """Add ``[nu_2 x a; nu_1 x a + nu_2 x b]`` to *out* (6,), bilinear in momentum and velocity (Fossen2011, (3.46)).

    C(nu) is never built in this form. Its derivative with respect to nu is two more calls, by the product rule.
    """
    a0, a1, a2, b0, b1, b2 = momentum[0], momentum[1], momentum[2], momentum[3], momentum[4], momentum[5]
    u, v, w, p, q, r = nu[0], nu[1], nu[2], nu[3], nu[4], nu[5]
    out[0] += q * a2 - r * a1
    out[1] += r * a0 - p * a2
    out[2] += p * a1 - q * a0
    out[3] += v * a2 - w * a1 + q * b2 - r * b1
    out[4] += w * a0 - u * a2 + r * b0 - p * b2
    out[5] += u * a1 - v * a0 + p * b1 - q * b0


@inlined
def _kinematics(P: Program, theta: Array, deriv: bool, f: Array, A: Array, W: Scratch) -> None:
    """Fill the eta rows of *f* and *A* from ``W.full``, which contains nu, then eta."""
    full = W.full
    active, place = P.active, P.column
    k = len(active)
    vx = theta[P.current_x] if P.current_x >= 0 else 0.0
    vy = theta[P.current_y] if P.current_y >= 0 else 0.0
    if P.drift_x >= 0:
        vx += theta[P.drift_x]
    if P.drift_y >= 0:
        vy += theta[P.drift_y]
    u, v, w, q, r = full[0], full[1], full[2], full[4], full[5]
    phi, tht, psi = full[9], full[10], full[11]
    cs, sn = (1.0, 0.0) if P.spatial == 0 and active[0] > 1 else (np.cos(psi), np.sin(psi))  # only a track needs them
    if P.spatial == 0:
        # Without roll and pitch J(eta) is a turn by psi in the plane; depth and heading are plain integrals.
        cu, cv, cr, cpsi = place[0], place[1], place[5], place[11]
        for i in range(k):
            d = active[i]
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
                    A[i, place[d]] = 1.0
        return
    # All six: J = diag(R, T), R by z-y-x Euler angles (Fossen2011, (2.18)), T from body rates to those of the angles
    # (2.26). T is singular at a pitch of 90 degrees; the motion is given up there, as when it runs away.
    cp, sp, ct, st = np.cos(phi), np.sin(phi), np.cos(tht), np.sin(tht)
    R, T, out, by = W.R, W.T, W.out, W.by
    R[0, 0], R[0, 1], R[0, 2] = cs * ct, -sn * cp + cs * st * sp, sn * sp + cs * cp * st
    R[1, 0], R[1, 1], R[1, 2] = sn * ct, cs * cp + sp * st * sn, -cs * sp + st * sn * cp
    R[2, 0], R[2, 1], R[2, 2] = -st, ct * sp, ct * cp
    T[0, 0], T[0, 1], T[0, 2] = 1.0, sp * st / ct, cp * st / ct
    T[1, 1], T[1, 2] = cp, -sp
    T[2, 1], T[2, 2] = sp / ct, cp / ct
    out[:] = 0.0
    for i in range(3):
        for j in range(3):
            out[i] += R[i, j] * full[j]
            out[3 + i] += T[i, j] * full[3 + j]
    out[0] += vx
    out[1] += vy
    for i in range(k):
        f[i] = out[active[i]]
    if not deriv:
        return
    # by: derivatives of J(eta) nu by phi, theta, psi; what is not filled here stays zero, as in T. Turning by psi turns
    # the velocity over ground (without the current) a quarter further, which is its third column.
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
        d = active[i]
        for j in range(3):
            c = place[j if d < 3 else 3 + j]
            if c >= 0:
                A[i, c] = R[d, j] if d < 3 else T[d - 3, j]
            c = place[9 + j]
            if c >= 0:
                A[i, c] = by[d, j]


@inlined
def _factor(
    code: int, full: Array, place: Index, u: Array, lagged: Array, first: int, reach: float, bottom: float
) -> tuple[float, float, int]:
    """Return value, derivative and state column (-1: none) of one factor.

    first : column of the first lagged input, or -1.
    """
    if code < NU_SIZE:
        return full[code], 1.0, place[code]
    if code < ETA:  # |u| as in u|u|; its kink does not matter, for another factor is zero there
        x = full[code - NU_SIZE]
        return abs(x), (1.0 if x >= 0.0 else -1.0), place[code - NU_SIZE]
    if code < SIN_PHI:  # positions stand in `full` behind the six velocities
        return full[code - ETA + 6], 1.0, place[code - ETA + 6]
    if code == SIN_PHI:
        return np.sin(full[9]), np.cos(full[9]), place[9]
    if code == SIN_THETA:
        return np.sin(full[10]), np.cos(full[10]), place[10]
    if code == SIN_PSI:
        return np.sin(full[11]), np.cos(full[11]), place[11]
    if code == COS_PSI:
        return np.cos(full[11]), -np.sin(full[11]), place[11]
    if code == NEAR:
        near = np.exp(min((full[8] - bottom) / reach, STEEPEST))
        return near, near / reach, place[8]
    i = code - INPUT_SIZE if code >= INPUT_SIZE else code - INPUT
    x = u[i] if first < 0 else lagged[i]  # with a lag the force follows the actuator's state, not the command
    column = first + i if first >= 0 else -1
    if code >= INPUT_SIZE:
        return abs(x), (1.0 if x >= 0.0 else -1.0), column
    return x, 1.0, column


class Scratch(NamedTuple):
    """Work arrays of a simulation, so that no evaluation allocates memory; see :func:`scratch`."""

    full: Array
    force: Array
    momentum: Array
    c: Array
    unit: Array
    column: Array
    by_x: Array
    by_p: Array
    values: Array
    slopes: Array
    columns: Index
    R: Array
    T: Array
    out: Array
    by: Array
    f: Array
    before: Array
    A: Array
    B: Array
    kx: Array
    ks: Array
    y: Array
    Y: Array


def scratch(n: int, q: int) -> Scratch:
    """Return work arrays for *n* states and *q* sensitivities.

    The function is not compiled, because compiling the creation of arrays takes long, and each simulation calls it only
    once.
    """
    return Scratch(
        np.zeros(12),
        np.zeros(6),
        np.zeros(6),
        np.zeros(6),
        np.zeros(6),
        np.zeros(6),
        np.zeros((6, n)),
        np.zeros((6, q)),
        np.zeros(3),
        np.zeros(3),
        np.zeros(3, dtype=np.int64),
        np.zeros((3, 3)),
        np.zeros((3, 3)),
        np.zeros(6),
        np.zeros((6, 3)),
        np.zeros(n),
        np.zeros(n),
        np.zeros((n, n)),
        np.zeros((n, q)),
        np.zeros((4, n)),
        np.zeros((4, n, q)),
        np.zeros(n),
        np.zeros((n, q)),
    )


@inlined
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
    W: Scratch,
) -> None:
    """Calculate the rate *f* (n,) of the state, and with *deriv* its derivatives *A* (n, n) and *B* (n, q), in place.

    M : (6, 6) inertia matrix.
    M_inverse : (k, k) inverse of its active part.
    free : (p,) column of ``B`` for each parameter, -1 if not requested.

    The column of the delay stays zero, because a delay acts only at the jumps.
    """
    active, place, inertia, inertia_coefs = P.active, P.column, P.inertia, P.inertia_coefs
    momentum, c = W.momentum, W.c
    k, n, q = len(active), len(x), B.shape[1]
    full, force, by_x, by_p = W.full, W.force, W.by_x, W.by_p
    for j in range(12):
        full[j] = x[place[j]] if place[j] >= 0 else 0.0
    if P.depth >= 0 and place[8] < 0:  # depth measured, not simulated: it enters as an input
        full[8] = u[P.depth]
    force[:] = 0.0
    if deriv:
        A[:, :] = 0.0
        B[:, :] = 0.0
        by_x[:, :] = 0.0
        by_p[:, :] = 0.0
    _kinematics(P, theta, deriv, f, A, W)
    if deriv:
        for i in range(k):
            if active[i] > 1:
                continue
            # A current carries the craft over ground; forces see the velocity through water, so only eta_dot has it.
            for par in (P.current_x, P.drift_x) if active[i] == 0 else (P.current_y, P.drift_y):
                if par >= 0 and free[par] >= 0:
                    B[i, free[par]] = 1.0
    _forces(P, theta, x[2 * k :], u, free, deriv, W)
    if P.coriolis == 1:
        _coriolis(place, M, deriv, W)
    for i in range(k):
        rate = 0.0
        for j in range(k):
            rate += M_inverse[i, j] * force[active[j]]
        f[k + i] = rate
    if P.lag >= 0:  # first order: T u_a_dot + u_a = u, each input with a state of its own behind eta and nu
        T = theta[P.lag]
        for i in range(P.m):
            f[2 * k + i] = (u[i] - x[2 * k + i]) / T
    if not deriv:
        return
    # nu_dot = M^-1 (F - C nu). Of d/d m: M d(nu_dot) = -dM nu_dot - dC nu, so an entry of M takes its share of the
    # acceleration (known by now) and of the momentum's cross products off the force, before M^-1 is applied below.
    for e in range(len(inertia_coefs)):
        row, col, par = inertia[e, 0], inertia[e, 1], inertia[e, 2]
        if par < 0 or free[par] < 0:
            continue
        at, weight = free[par], inertia_coefs[e]
        if place[col] >= 0:
            by_p[row, at] -= weight * f[place[col]]
        if P.coriolis == 1:
            momentum[:] = 0.0
            momentum[row] = weight * full[col]
            c[:] = 0.0
            _cross(momentum, full, c)
            for i in range(6):
                by_p[i, at] -= c[i]
    for i in range(k):
        for j in range(k):
            g = M_inverse[i, j]
            if g == 0.0:
                continue
            d = active[j]
            for o in range(n):
                A[k + i, o] += g * by_x[d, o]
            for o in range(q):
                B[k + i, o] += g * by_p[d, o]
    if P.lag >= 0:
        T = theta[P.lag]
        for i in range(P.m):
            A[2 * k + i, 2 * k + i] = -1.0 / T
            if free[P.lag] >= 0:
                B[2 * k + i, free[P.lag]] = -f[2 * k + i] / T


@pasted
def _forces(P: Program, theta: Array, lagged: Array, u: Array, free: Index, deriv: bool, W: Scratch) -> None:
    """Add all terms to ``W.force``, and with *deriv* their derivatives to ``W.by_x`` and ``W.by_p``."""
    rows, pars, scales, coefs, factors, place = P.rows, P.pars, P.scales, P.coefs, P.factors, P.column
    values, slopes, columns, full = W.values, W.slopes, W.columns, W.full
    force, by_x, by_p = W.force, W.by_x, W.by_p
    first = 2 * len(P.active) if P.lag >= 0 else -1
    reach = theta[P.reach] if P.reach >= 0 else 1.0
    bottom = theta[P.bottom] if P.bottom >= 0 else 0.0
    for t in range(len(rows)):
        row, par, scale = rows[t], pars[t], scales[t]
        count = 0
        for s in range(3):
            values[s] = 1.0
            if factors[t, s] >= 0:
                values[s], slopes[s], columns[s] = _factor(factors[t, s], full, place, u, lagged, first, reach, bottom)
                count = s + 1
        product = coefs[t] * values[0] * values[1] * values[2]
        # theta_p theta_s: a form may tie two derivatives, such as a rudder's arm times its lift.
        first_weight = theta[par] if par >= 0 else 1.0
        second_weight = theta[scale] if scale >= 0 else 1.0
        weight = first_weight * second_weight
        force[row] += weight * product
        if not deriv:
            continue
        if par >= 0 and free[par] >= 0:
            by_p[row, free[par]] += second_weight * product
        if scale >= 0 and free[scale] >= 0:
            by_p[row, free[scale]] += first_weight * product
        for s in range(count):
            rest = values[1] * values[2] if s == 0 else values[0] * values[3 - s]  # the product rule, of three factors
            slope = weight * coefs[t] * slopes[s] * rest
            if columns[s] >= 0:
                by_x[row, columns[s]] += slope
            if factors[t, s] == NEAR:  # exp((z - bottom) / reach): both numbers of it may be fitted
                if P.bottom >= 0 and free[P.bottom] >= 0:
                    by_p[row, free[P.bottom]] -= slope
                if P.reach >= 0 and free[P.reach] >= 0:
                    by_p[row, free[P.reach]] -= slope * (full[8] - bottom) / reach
    payload = P.payload
    for row in range(6):  # the same forces on u times the inertia, as shares of it: M stays constant and inverted once
        if payload[row] >= 0:
            share = 1.0 / u[payload[row]]
            force[row] *= share
            if deriv:
                for o in range(by_x.shape[1]):
                    by_x[row, o] *= share
                for o in range(by_p.shape[1]):
                    by_p[row, o] *= share


@pasted
def _coriolis(place: Index, M: Array, deriv: bool, W: Scratch) -> None:
    """Subtract ``C(nu) nu`` from ``W.force``, and with *deriv* its derivative from ``W.by_x``."""
    momentum, c, unit, column = W.momentum, W.c, W.unit, W.column
    full, force, by_x = W.full, W.force, W.by_x
    for i in range(6):
        momentum[i] = 0.0
        c[i] = 0.0
        unit[i] = 0.0
        for j in range(6):
            momentum[i] += M[i, j] * full[j]
    _cross(momentum, full, c)
    for i in range(6):
        force[i] -= c[i]
    if not deriv:
        return
    for j in range(6):
        if place[j] < 0:
            continue
        for i in range(6):
            c[i] = 0.0
            column[i] = M[i, j]
        unit[j] = 1.0
        _cross(column, full, c)
        _cross(momentum, unit, c)
        unit[j] = 0.0
        for i in range(6):
            by_x[i, place[j]] -= c[i]


@pasted
def _rate(A: Array) -> float:
    """Return a measure of the fastest rate [1/s] that does not depend on the units of the states.

    ``|a_ij a_ji|`` does not change when states are scaled. For a coupled pair it is the square of its rate. Eigenvalues
    are not calculated: only the order of magnitude is needed, and they would take longer than the step itself.
    """
    largest = 0.0
    for i in range(A.shape[0]):
        total = 0.0
        for j in range(A.shape[1]):
            total += np.sqrt(abs(A[i, j] * A[j, i]))
        largest = max(largest, total)
    return largest


@inlined
def _advance(
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
    max_rate: float,
    f: Array,
    W: Scratch,
) -> tuple[bool, float]:
    """Advance state and sensitivities by *span*; return whether they stayed finite, and the fastest rate that
    occurred.

    A span of zero only fills *f* with the state's rate.
    """
    n, q = S.shape
    A, B, kx, ks, y, Y = W.A, W.B, W.kx, W.ks, W.y, W.Y
    # Steps are as short as the rate asks that the caller expects, not as the one met: the same number whatever the
    # parameters, for a step count that jumps between two evaluations is a jump in the likelihood. The rate met is
    # returned, and the caller does it all again where it was faster.
    steps = int(np.ceil(span * max_rate / REACH))
    if steps < 1:
        steps = 1
    h = span / steps
    fastest = 0.0
    for step in range(steps):
        for stage in range(4):
            c = 0.0 if stage == 0 else (1.0 if stage == 3 else 0.5)
            for i in range(n):
                y[i] = x[i] + (c * h * kx[stage - 1, i] if stage > 0 else 0.0)
            begin = stage == 0 and step == 0 and span > 0.0
            evaluate(P, theta, M, M_inverse, y, u, free, deriv or begin, f, A, B, W)
            if span == 0.0:
                return True, fastest
            for i in range(n):
                kx[stage, i] = f[i]
            if begin:
                fastest = _rate(A)
            if deriv:  # S_dot = A S + B through the same four stages
                for i in range(n):
                    for j in range(q):
                        Y[i, j] = S[i, j] + (c * h * ks[stage - 1, i, j] if stage > 0 else 0.0)
                for i in range(n):
                    for j in range(q):
                        ks[stage, i, j] = B[i, j]
                    for o in range(n):
                        a = A[i, o]
                        if a != 0.0:  # few are not, and each costs q products
                            for j in range(q):
                                ks[stage, i, j] += a * Y[o, j]
        for i in range(n):
            x[i] += h / 6.0 * (kx[0, i] + 2.0 * kx[1, i] + 2.0 * kx[2, i] + kx[3, i])
            if not abs(x[i]) < RUNAWAY:
                return False, fastest
            if deriv:
                for j in range(q):
                    S[i, j] += h / 6.0 * (ks[0, i, j] + 2.0 * ks[1, i, j] + 2.0 * ks[2, i, j] + ks[3, i, j])
    return True, fastest


def _carry(
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
    max_rate: float,
    max_steps: float,
    W: Scratch,
) -> tuple[bool, float, int, float]:
    """Advance state *x* (n,) and sensitivities *S* (n, q) from *t* to *stop* through the jumps of the inputs.

    free : (p,) column of each parameter in *S*, -1 if it is known.
    max_rate : fastest rate [1/s] that steps are sized for.
    max_steps : maximum number of steps.

    Return whether the motion stayed finite, the fastest rate, the input row at *stop*, and the number of steps.
    """
    deriv, plain = S.shape[1] > 0, S.shape[1] < 0  # no literals: everything would be compiled again for each
    delay = theta[P.delay] if P.delay >= 0 else 0.0
    column = free[P.delay] if P.delay >= 0 else -1
    fastest, spent = 0.0, 0.0
    while t < stop:
        jump = row + 1 < len(t_in) and t_in[row + 1] + delay <= stop
        until = t_in[row + 1] + delay if jump else stop
        if until > t:
            spent += (until - t) * max_rate / REACH
            if spent > max_steps:
                return False, fastest, row, spent
            finite, rate = _advance(P, theta, M, M_inverse, x, S, inputs[row], free, until - t, deriv, max_rate, W.f, W)
            fastest = max(fastest, rate)
            if not finite:
                return False, fastest, row, spent
            t = until
        if jump:
            if deriv and column >= 0:
                # A longer delay keeps the input before in force longer, in the place of the one after: the state's
                # sensitivity jumps by the difference of their rates. A span of none gives a rate: `evaluate` inlined
                # here would be compiled again.
                for k in range(2):
                    rates = W.before if k == 0 else W.f
                    _advance(P, theta, M, M_inverse, x, S, inputs[row + k], free, 0.0, plain, max_rate, rates, W)
                for i in range(len(x)):
                    S[i, column] += W.before[i] - W.f[i]
            row += 1
    return True, fastest, row, spent


carry = called(_carry)
_carried = pasted(_carry)
"""Same function as :func:`_carry`, inlined for simulations.

Passing the hundreds of words of ``P`` and ``W`` once per sample takes a third of the simulation time.
"""


@njit(cache=True, nogil=True, error_model="numpy")
def _sweep(
    P: Program,
    theta: Array,
    M: Array,
    M_inverse: Array,
    x: Array,
    S: Array,
    row: int,
    t_in: Array,
    inputs: Array,
    t_out: Array,
    free: Index,
    max_rate: float,
    max_steps: float,
    abandon_rate: float,
    X: Array,
    S_out: Array,
    none: Array,
    W: Scratch,
) -> tuple[bool, float]:
    n = len(x)
    t, fastest, left = t_out[0], 0.0, max_steps
    for s in range(len(t_out)):
        if fastest > abandon_rate:
            S = none
        q = S.shape[1]
        finite, rate, row, spent = _carried(
            P, theta, M, M_inverse, x, S, t, t_out[s], row, t_in, inputs, free, max_rate, left, W
        )
        fastest = max(fastest, rate)
        if not finite:
            return False, fastest
        t = max(t, t_out[s])
        left -= spent
        for i in range(n):
            X[s, i] = x[i]
            for c in range(q):
                S_out[s, i, c] = S[i, c]
    return True, fastest


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
    max_rate: float,
    max_steps: float,
    X: Array,
    S_out: Array,
    abandon_rate: float = np.inf,
) -> tuple[bool, float]:
    """Simulate from ``x_0`` at ``t_out[0]``, and fill the states ``X`` (s, n) and the sensitivities ``S_out`` (s, n,
    q).

    inputs : (j, m), each row applies from its stamp in ``t_in`` (plus the delay). The first row also applies before it.
    state_column : (n,) column of the sensitivity to each initial state, -1 if it is known.
    free : as for :func:`evaluate`, all -1 without sensitivities.
    max_rate : fastest rate [1/s] that steps are sized for.
    max_steps : maximum number of steps.
    abandon_rate : rate [1/s] above which ``S_out`` is not filled, because the simulation is repeated with shorter
        steps.

    Return whether the motion stayed finite, and the fastest rate that occurred.
    """
    n, q = len(x_0), S_out.shape[2]
    S = np.zeros((n, q))
    for i, column in enumerate(state_column):
        if 0 <= column < q:
            S[i, column] = 1.0
    delay = theta[P.delay] if P.delay >= 0 else 0.0
    row = max(int(np.searchsorted(t_in + delay, t_out[0], side="right")) - 1, 0)
    finite, fastest = _sweep(
        P,
        theta,
        M,
        M_inverse,
        x_0.copy(),
        S,
        row,
        t_in,
        inputs,
        t_out,
        free,
        max_rate,
        float(max_steps),
        abandon_rate,
        X,
        S_out,
        np.zeros((n, 0)),
        scratch(n, q),
    )
    return bool(finite), float(fastest)
