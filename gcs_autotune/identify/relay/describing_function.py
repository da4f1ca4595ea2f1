"""Describing function of the relay with hysteresis, and how integrators and delays turn it.

``x = x_0 + X_m sin(omega t)`` into a relay of output ``C`` that switches at ``+/- x_a`` gives, to the first
harmonic, ``Y_0 + (P_N + j Q_N) (x - x_0)``: Miskovic2010, eq. (5.10)-(5.14).
"""

from __future__ import annotations

import math

__all__ = ["from_delay", "from_integrators", "is_valid", "quadratic_drag", "relay", "relay_bias"]


def is_valid(X_m: float, x_a: float, x_0: float = 0.0) -> bool:
    """Return whether an oscillation lies inside the describing function's domain, Miskovic2010, eq. (7.12)."""
    return X_m > 0.0 and x_a + abs(x_0) < X_m


def relay(C: float, X_m: float, x_a: float, x_0: float = 0.0) -> tuple[float, float]:
    """Return ``(P_N, Q_N)`` of a relay with hysteresis, Miskovic2010, eq. (5.13), (5.14) = (6.45), (6.46).

    ``C`` in input units; ``X_m``, ``x_a``, ``x_0`` in one unit of the output. Outside (7.12) a square root
    has no value; it is taken as 0 there, and :func:`is_valid` says so.
    """
    upper = math.sqrt(max(0.0, 1.0 - ((x_a - x_0) / X_m) ** 2))
    lower = math.sqrt(max(0.0, 1.0 - ((x_a + x_0) / X_m) ** 2))
    return 2.0 * C / (math.pi * X_m) * (upper + lower), -4.0 * C * x_a / (math.pi * X_m**2)


def relay_bias(C: float, X_m: float, x_a: float, x_0: float = 0.0) -> float:
    """Return the relay's mean output ``Y_0`` for a biased input, Miskovic2010, eq. (5.11); |x_a| + |x_0| <= X_m."""
    return C / math.pi * (math.asin((x_a + x_0) / X_m) - math.asin((x_a - x_0) / X_m))


def from_integrators(P: float, Q: float, omega: float, k: int) -> tuple[float, float]:
    """Return ``(P, Q)`` with *k* integrators of the process joined to the relay, Miskovic2010, eq. (6.25)."""
    for _ in range(k):
        P, Q = Q / omega, -P / omega
    return P, Q


def from_delay(P: float, Q: float, omega: float, delay: float) -> tuple[float, float]:
    """Return ``(P, Q)`` with a known *delay* [s] of the process joined to the relay, Miskovic2010, eq. (6.31)."""
    cosine, sine = math.cos(omega * delay), math.sin(omega * delay)
    return P * cosine + Q * sine, Q * cosine - P * sine


def quadratic_drag(nu_0: float, amplitude: float) -> tuple[float, float]:
    """Return mean and gain of ``|nu| nu`` for ``nu = nu_0 + amplitude sin(omega t)``, amplitude > 0.

    Miskovic2010 gives the gain for ``nu_0 = 0``, ``8/(3 pi) amplitude`` in (6.41)-(6.43); here its Fourier integrals
    are taken for any *nu_0*, because surge may oscillate around a speed (6.48). Beyond ``|nu_0| = amplitude`` the
    velocity never changes sign and the gain is ``2 |nu_0|``.
    """
    if abs(nu_0) >= amplitude:
        return math.copysign(nu_0**2 + 0.5 * amplitude**2, nu_0), 2.0 * abs(nu_0)
    s = nu_0 / amplitude
    theta, c = math.asin(s), math.sqrt(1.0 - s * s)
    mean = amplitude**2 / math.pi * ((2.0 * s * s + 1.0) * theta + 3.0 * s * c)
    return mean, 4.0 * amplitude / math.pi * (s * theta + c - c**3 / 3.0)
