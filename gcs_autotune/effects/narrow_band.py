"""A narrow-band disturbance in white noise: a damped oscillator driven by white noise, seen through a Kalman filter.

``x'' + 2 zeta omega x' + omega^2 x = w``, the second-order shaping filter of waves (Fossen 2011, ch. 8), sampled
exactly; a signal shows ``x`` and white noise, ``rho`` their ratio of variances. The prediction errors of the filter
are white when the law is right, and the determinant of the whole is the product of their variances (Harvey 1989, 3.4).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

__all__ = ["Oscillator", "Record", "cost", "driven", "whitened"]

Array = NDArray[np.float64]

Record = tuple[Array, Array]
"""Stamps (n,) [s] and what is left over (n,) of one signal of one run."""


@dataclass(frozen=True, slots=True)
class Oscillator:
    """``omega`` [rad/s], damping ratio ``zeta`` < 1, and ``rho`` variance of the oscillation per that of the noise."""

    omega: float
    zeta: float
    rho: float


def whitened(law: Oscillator, t: Array, columns: Array) -> tuple[Array, Array]:
    """Return one-step prediction errors of *columns* (n, k), over their relative deviation, and the latter (n,).

    The first column is the record, the others (derivatives, regressors) go through the same filter. The deviation is
    the standard one, relative to that of the white noise.
    """
    E, S = _innovations(
        np.ascontiguousarray(t, dtype=np.float64),
        np.ascontiguousarray(columns, dtype=np.float64),
        law.omega,
        law.zeta,
        law.rho,
    )
    deviation = np.sqrt(S)
    return E / deviation[:, None], deviation


def cost(law: Oscillator | None, records: Sequence[Record]) -> float:
    """Return minus twice the log-likelihood of one signal's *records*, the noise level at its best; None: white noise.

    Less ``n (1 + log(2 pi))``.
    """
    n, square, logs = 0, 0.0, 0.0
    for t, error in records:
        if law is None:
            square += float(error @ error)
        else:
            E, deviation = whitened(law, t, error[:, None])
            square += float(E[:, 0] @ E[:, 0])
            logs += 2.0 * float(np.sum(np.log(deviation)))
        n += len(error)
    return n * math.log(max(square / max(n, 1), 1e-300)) + logs


def driven(law: Oscillator, t: Array, push: Array) -> tuple[Array, Array]:
    """Return how the oscillator, at rest first, answers to *push* (n,): position and velocity over omega, (n,) each."""
    found = _driven(np.ascontiguousarray(t), np.ascontiguousarray(push), law.omega, law.zeta)
    return found[:, 0], found[:, 1]


@njit(cache=True)
def _transition(omega: float, zeta: float, dt: float) -> tuple[float, float, float, float]:
    """Return the transition of (x, x'/omega) over *dt*, row by row."""
    damped = np.sqrt(1.0 - zeta * zeta)
    decay = np.exp(-zeta * omega * dt)
    c, s = np.cos(damped * omega * dt), np.sin(damped * omega * dt) / damped
    return decay * (c + zeta * s), decay * s, -decay * s, decay * (c - zeta * s)


@njit(cache=True)
def _innovations(t: Array, Y: Array, omega: float, zeta: float, rho: float) -> tuple[Array, Array]:
    n, k = Y.shape
    E, S = np.empty((n, k)), np.empty(n)
    x = np.zeros((2, k))
    p00, p01, p11 = rho, 0.0, rho
    last, f00, f01, f10, f11 = -1.0, 1.0, 0.0, 0.0, 1.0
    for i in range(n):
        if i > 0:
            dt = t[i] - t[i - 1]
            if abs(dt - last) > 1e-9:
                f00, f01, f10, f11 = _transition(omega, zeta, dt)
                last = dt
            q00 = rho * (1.0 - f00 * f00 - f01 * f01)
            q01 = -rho * (f00 * f10 + f01 * f11)
            q11 = rho * (1.0 - f10 * f10 - f11 * f11)
            a00, a01 = f00 * p00 + f01 * p01, f00 * p01 + f01 * p11
            a10, a11 = f10 * p00 + f11 * p01, f10 * p01 + f11 * p11
            p00 = a00 * f00 + a01 * f01 + q00
            p01 = a00 * f10 + a01 * f11 + q01
            p11 = a10 * f10 + a11 * f11 + q11
            for j in range(k):
                x0, x1 = x[0, j], x[1, j]
                x[0, j] = f00 * x0 + f01 * x1
                x[1, j] = f10 * x0 + f11 * x1
        s = p00 + 1.0
        S[i] = s
        g0, g1 = p00 / s, p01 / s
        for j in range(k):
            e = Y[i, j] - x[0, j]
            E[i, j] = e
            x[0, j] += g0 * e
            x[1, j] += g1 * e
        p11 -= g1 * p01
        p01 -= g0 * p01
        p00 -= g0 * p00
    return E, S


@njit(cache=True)
def _driven(t: Array, push: Array, omega: float, zeta: float) -> Array:
    out = np.zeros((len(t), 2))
    for i in range(1, len(t)):
        dt = t[i] - t[i - 1]
        f00, f01, f10, f11 = _transition(omega, zeta, dt)
        # Held push: equilibrium at push, approached along the free motion.
        x0, x1 = out[i - 1, 0] - push[i - 1], out[i - 1, 1]
        out[i, 0] = push[i - 1] + f00 * x0 + f01 * x1
        out[i, 1] = f10 * x0 + f11 * x1
    return out
