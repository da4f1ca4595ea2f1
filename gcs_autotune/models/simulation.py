"""Exact simulation of :class:`SingleDof` under a held input, with sensitivities to every parameter.

Between two jumps of the input, the motion ``nu_dot = F - a*nu - c*|nu|*nu`` is a polynomial differential equation on
either side of ``nu = 0``. Its Taylor coefficients follow from a short recursion. A step is one Taylor polynomial of
degree :data:`DEGREE`, or less if the step is short. It covers at most :data:`REACH` of the fastest time constant. It
ends exactly at an input jump, an output stamp, or a change of sign of the velocity. The error stays near rounding
(below 1e-11 relative) for any sampling.

Parameters here are those of the explicit form ``nu_dot = b*tau(t - delay) - a*nu - c*|nu|*nu + d``. They correspond to
``alpha = 1/b, beta = a/b, beta_quadratic = c/b, delta = d/b`` of Miskovic2010, eq. (6.33)-(6.34).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.jit import called, entry_without_lock, pasted
from gcs_autotune.models.single_dof import SingleDof
from gcs_autotune.notebook import Displayed

__all__ = ["COLUMNS", "SimulatedMotion", "explicit_parameters", "simulate", "simulate_explicit"]

Array = NDArray[np.float64]

COLUMNS = ("b", "a", "c", "d", "delay", "eta_0", "nu_0")
"""Names of the columns of the sensitivities, in order."""

DEGREE = 12
"""Highest degree of the Taylor polynomials.

With :data:`REACH` the error is 0.13**13 = 3e-12 of the change in a step. Project choice.
"""

REACH = 0.2
"""Longest step, as a fraction of the fastest time constant.

The poles of the solution are 8 times farther away. Project choice.
"""

LEFT = math.log(0.13) * (DEGREE + 1)
"""Logarithm of the truncation error of a full step of :data:`REACH`.

A shorter step needs fewer terms of the Taylor polynomial for the same error.
"""

RUNAWAY = 1e9
"""Velocity [rad/s or m/s] at which a simulation with destabilising drag is abandoned. Project choice."""

STEPS_PER_SAMPLE = 500
"""Mean number of steps per output stamp above which a simulation is abandoned as too stiff. Project choice."""


@dataclass(frozen=True, slots=True, eq=False)
class SimulatedMotion(Displayed):
    """A simulated run at the requested stamps.

    - ``eta``, ``nu`` (n,): position [rad or m] and velocity [rad/s or m/s].
    - ``eta_by``, ``nu_by`` (n, 7): derivatives of ``eta`` and ``nu`` by :data:`COLUMNS`.
    - ``finite``: False if the simulation diverged. The arrays then contain NaN.
    """

    eta: Array
    nu: Array
    eta_by: Array
    nu_by: Array
    finite: bool


def _series(a: float, c: float, force: float, nu: float, side: float, degree: int, w: Array) -> None:
    """Fill ``w`` (5, DEGREE + 1) with Taylor coefficients up to *degree* on one side of ``nu = 0``.

    Rows: velocity, homogeneous sensitivity, and the particular sensitivities to ``d``, ``a``, ``c``. The first
    coefficients of the latter must be zero on entry and stay zero.
    """
    w[0, 0], w[1, 0] = nu, 1.0
    k2 = 2.0 * side * c
    for n in range(degree):
        square, s1, s2, s3, s4 = 0.0, 0.0, 0.0, 0.0, 0.0
        for i in range(n + 1):
            x = w[0, i]
            square += x * w[0, n - i]
            s1 += x * w[1, n - i]
            s2 += x * w[2, n - i]
            s3 += x * w[3, n - i]
            s4 += x * w[4, n - i]
        g = 1.0 / (n + 1)
        one = 1.0 if n == 0 else 0.0
        w[0, n + 1] = g * (force * one - a * w[0, n] - side * c * square)
        w[1, n + 1] = g * (-a * w[1, n] - k2 * s1)
        w[2, n + 1] = g * (-a * w[2, n] - k2 * s2 + one)
        w[3, n + 1] = g * (-a * w[3, n] - k2 * s3 - w[0, n])
        w[4, n + 1] = g * (-a * w[4, n] - k2 * s4 - side * square)


def _value(series: Array, h: float, degree: int) -> float:
    """Evaluate one row of ``w`` at *h*.

    The row itself is passed, because numba compiles again for every literal row number.
    """
    total = series[degree]
    for n in range(degree - 1, -1, -1):
        total = total * h + series[n]
    return float(total)


def _area(series: Array, h: float, degree: int) -> float:
    """Integrate one row of ``w`` from 0 to *h*."""
    total = series[degree] / (degree + 1)
    for n in range(degree - 1, -1, -1):
        total = total * h + series[n] / (n + 1)
    return float(total * h)


def _crossing(w: Array, h: float, side: float, degree: int) -> float:
    """Return the time in (0, h] at which the velocity, which is monotone there, crosses zero, by bisection."""
    low, high = 0.0, h
    for _ in range(60):
        middle = 0.5 * (low + high)
        if _value(w[0], middle, degree) * side > 0.0:
            low = middle
        else:
            high = middle
    return high


def _step(x: Array, p: Array, tau: float, rest: float, w: Array, by_nu: Array, by_eta: Array) -> float:
    """Advance state ``x`` = (eta, nu) and sensitivities by at most *rest*; return the time advanced."""
    b, a, c, d = p[0], p[1], p[2], p[3]
    force, nu = b * tau + d, x[1]
    side = 1.0 if nu > 0.0 or (nu == 0.0 and force >= 0.0) else -1.0
    rate = abs(a) + 2.0 * abs(c * nu) + 2.0 * math.sqrt(abs(c * force))
    h = rest if rate * rest <= REACH else REACH / rate
    share = rate * h / REACH
    degree = 2 if share < 1e-9 else int(LEFT / math.log(0.13 * share))
    degree = 2 if degree < 2 else (DEGREE if degree > DEGREE else degree)
    _series(a, c, force, nu, side, degree, w)
    after = _value(w[0], h, degree)
    if nu != 0.0 and after * side < 0.0:
        h = _crossing(w, h, side, degree)
        after = 0.0
    x[0] += _area(w[0], h, degree)
    x[1] = after
    phi, phi_area = _value(w[1], h, degree), _area(w[1], h, degree)
    for i in range(7):
        by_eta[i] += by_nu[i] * phi_area
        by_nu[i] *= phi
    unit, unit_area = _value(w[2], h, degree), _area(w[2], h, degree)
    by_nu[0] += tau * unit
    by_eta[0] += tau * unit_area
    by_nu[1] += _value(w[3], h, degree)
    by_eta[1] += _area(w[3], h, degree)
    by_nu[2] += _value(w[4], h, degree)
    by_eta[2] += _area(w[4], h, degree)
    by_nu[3] += unit
    by_eta[3] += unit_area
    return h


def _sweep(
    p: Array, t_in: Array, u_in: Array, t_out: Array, eta: Array, nu: Array, eta_by: Array, nu_by: Array, w: Array
) -> bool:
    """Simulate ``p`` = (b, a, c, d, delay, eta_0, nu_0) from ``t_out[0]`` on; return False if the motion diverged.

    ``w`` (8, DEGREE + 1) is a work array of zeros, because allocation takes longest to compile.
    """
    x, by_eta, by_nu = w[5, :2], w[6, :7], w[7, :7]
    x[0], x[1] = p[5], p[6]
    by_eta[5], by_nu[6] = 1.0, 1.0
    delay, t, j, steps = p[4], t_out[0], 0, 0
    while j + 1 < len(t_in) and t_in[j + 1] + delay <= t:
        j += 1
    for k in range(len(t_out)):
        while t < t_out[k]:
            jump = j + 1 < len(t_in) and t_in[j + 1] + delay <= t_out[k]
            stop = t_in[j + 1] + delay if jump else t_out[k]
            while t < stop:
                rest = stop - t
                h = _step(x, p, u_in[j], rest, w, by_nu, by_eta)
                t = stop if h >= rest else t + h
                steps += 1
                if not abs(x[1]) < RUNAWAY or steps > STEPS_PER_SAMPLE * len(t_out):
                    return False
            if jump:
                by_nu[4] -= p[0] * (u_in[j + 1] - u_in[j])
                j += 1
        eta[k], nu[k] = x[0], x[1]
        for i in range(7):
            eta_by[k, i], nu_by[k, i] = by_eta[i], by_nu[i]
    return True


# Compiled in place, innermost first; each keeps its name so that the ones above call the compiled form.
_series = pasted(_series)
_value = called(_value)
_area = called(_area)
_crossing = pasted(_crossing)
_step = pasted(_step)
_compiled_sweep: Callable[..., bool] = entry_without_lock(_sweep)


def explicit_parameters(model: SingleDof) -> tuple[float, float, float, float, float]:
    """Return the explicit parameters ``(b, a, c, d, delay)`` of *model*, whose ``alpha`` must not be zero."""
    b = 1.0 / model.alpha
    return b, b * model.beta, b * model.beta_quadratic, b * model.delta, model.delay


def simulate(
    model: SingleDof, t_in: Array, tau: Array, t_out: Array, eta_0: float = 0.0, nu_0: float = 0.0
) -> SimulatedMotion:
    """Return the motion of *model*, simulated from ``(eta_0, nu_0)`` at ``t_out[0]``, with its derivatives.

    Parameters
    ----------
    t_in, tau : (m,) stamps [s] and input. Each value is held from its stamp to the next, and the first also applies
        before it.
    t_out : (n,) non-decreasing timestamps [s] of the output, evenly spaced or not.
    """
    return simulate_explicit((*explicit_parameters(model), eta_0, nu_0), t_in, tau, t_out)


def simulate_explicit(p: tuple[float, ...] | Array, t_in: Array, tau: Array, t_out: Array) -> SimulatedMotion:
    """Return the motion of the explicit form, with its derivatives.

    *p* contains the seven values of :data:`COLUMNS`, with ``delay >= 0``.
    """
    n = len(t_out)
    eta, nu, eta_by, nu_by = np.empty(n), np.empty(n), np.empty((n, 7)), np.empty((n, 7))
    as_floats = np.ascontiguousarray
    finite = bool(
        _compiled_sweep(
            np.asarray(p, dtype=np.float64),
            as_floats(t_in, dtype=np.float64),
            as_floats(tau, dtype=np.float64),
            as_floats(t_out, dtype=np.float64),
            eta,
            nu,
            eta_by,
            nu_by,
            np.zeros((8, DEGREE + 1)),
        )
    )
    if not finite:
        for array in (eta, nu, eta_by, nu_by):
            array.fill(math.nan)
    return SimulatedMotion(eta, nu, eta_by, nu_by, finite)
