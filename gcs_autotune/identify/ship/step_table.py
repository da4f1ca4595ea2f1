"""Miskovic2010, table 4.1: a model of one degree of freedom from two numbers read off a step response.

``tau`` is the input after the step, ``Delta`` included; all signs as recorded. ``k_ss`` is the steady velocity
((4.28), (4.39)), ``eps_v`` the velocity error (4.40): what the settled position line shows at the instant of the
step. The same closed forms are the special cases of two integrals along the response, :func:`lag` and
:func:`time_to`, which hold for any structure and any velocity before the step.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "lag",
    "linear_type_0",
    "linear_type_1",
    "nonlinear_type_0",
    "nonlinear_type_1",
    "steady",
    "time_to",
]

Array = NDArray[np.float64]

Drags = tuple[float, float]
"""beta, beta_quadratic."""

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(24)


def linear_type_1(tau: float, k_ss: float, eps_v: float, eta_0: float = 0.0) -> tuple[float, float]:
    """Return (alpha, beta) of a linear model from its measured position; (4.43), (4.44)."""
    return (eta_0 - eps_v) * tau / k_ss**2, tau / k_ss


def nonlinear_type_1(tau: float, k_ss: float, eps_v: float, eta_0: float = 0.0) -> tuple[float, float]:
    """Return (alpha, beta_quadratic) of a nonlinear model from its measured position; (4.47), (4.48)."""
    return (eta_0 - eps_v) * tau / (k_ss**2 * math.log(2.0)), tau / (k_ss * abs(k_ss))


def linear_type_0(tau: float, K_ss: float, T_L: float) -> tuple[float, float]:
    """Return (alpha, beta) of a linear model from its measured velocity; (4.31), (4.32).

    T_L : seconds to 63.2 % of the steady velocity, (4.33).
    """
    return T_L * tau / K_ss, tau / K_ss


def nonlinear_type_0(tau: float, K_ss: float, T_N: float) -> tuple[float, float]:
    """Return (alpha, beta_quadratic) of a nonlinear model from its measured velocity; (4.36), (4.37).

    T_N : seconds to tanh(1) = 76.2 % of the steady velocity, (4.38).
    """
    return T_N * tau / K_ss, tau / (K_ss * abs(K_ss))


def steady(drags: Drags, tau: float) -> float:
    """Return the velocity at which drag balances *tau* (Delta included); (4.31) and (4.36) in one."""
    beta, quadratic = drags
    if quadratic == 0.0:
        return tau / beta
    sign = math.copysign(1.0, quadratic)
    force, b, c = sign * tau, sign * beta, abs(quadratic)
    return math.copysign((-b + math.sqrt(max(b * b + 4.0 * c * abs(force), 0.0))) / (2.0 * c), force)


def lag(alpha: float, drags: Drags, tau: float, nu_0: float) -> float:
    """Return the position lost to the transient, eta_0 - eps_v = integral of (k_ss - nu) dt over the response.

    From rest: ``alpha*tau/beta^2`` for the linear model (4.44), ``sgn(tau)*alpha/beta_nn*ln 2`` for the nonlinear
    one (4.48).
    """
    k = steady(drags, tau)
    return alpha * _along(drags, tau, nu_0, k, lambda nu: k - nu)


def time_to(alpha: float, drags: Drags, tau: float, nu_0: float, level: float) -> float:
    """Return the seconds from velocity *nu_0* to *level*, which lies before the steady one; (4.32), (4.37)."""
    return alpha * _along(drags, tau, nu_0, level, np.ones_like)


def _along(drags: Drags, tau: float, nu_0: float, nu_1: float, weight: Callable[[Array], Array]) -> float:
    """Return the integral of weight(nu)/(tau - drag(nu)) from *nu_0* to *nu_1*, split where nu changes sign."""
    borders = [nu_0, 0.0, nu_1] if nu_0 * nu_1 < 0.0 else [nu_0, nu_1]
    total = 0.0
    for a, b in itertools.pairwise(borders):
        half = 0.5 * (b - a)
        nu = 0.5 * (a + b) + half * _NODES
        left = tau - (drags[0] + drags[1] * np.abs(nu)) * nu
        total += half * float(_WEIGHTS @ (weight(nu) / left))
    return total
