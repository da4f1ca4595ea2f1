"""A narrow-band force on a craft, with white measurement noise: damped oscillator, the craft's lag, and a Kalman
filter.

The force is white noise through ``K s / (s^2 + 2 zeta omega s + omega^2)`` (Fossen2011, (8.118)). The velocity follows
the force with the craft's time constant, and the position is the integral of the velocity. Let ``x`` be the
oscillator's position and ``z`` its lagged value, ``T z' = x - z``. A measured position then shows ``z``, and a measured
velocity ``x - z``, each with white noise. All are sampled exactly. If the model is right, the prediction errors of the
filter are white. The determinant of the covariance is the product of their variances (Harvey1989, section 3.4).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

__all__ = ["Oscillator", "Record", "cost", "driven", "rung", "whitened"]

Array = NDArray[np.float64]

Record = tuple[Array, Array]
"""Stamps (n,) [s] and residual (n,) of one signal of one run."""


DEAF = 0.03
"""Least damping ratio of an oscillator that the craft's own motion excites. Set by hand, see :func:`driven`."""
SETTLED = 20
"""Number of samples after which the filter's gain counts as stationary, for even stamps."""


@dataclass(frozen=True, slots=True)
class Oscillator:
    """Model of one signal: frequency ``omega`` [rad/s], damping ratio ``zeta`` < 1, ``lag`` [s] of the craft.

    - ``rho``: variance of the oscillation relative to that of the noise.
    - ``rate``: whether a velocity is measured, not a position.
    """

    omega: float
    zeta: float
    lag: float
    rate: bool
    rho: float

    @property
    def share(self) -> float:
        """Variance of ``z`` in a position, relative to that of ``x``; for a velocity, one minus this value."""
        return _lagged(self.omega, self.zeta, self.lag)[0]


def whitened(law: Oscillator, t: Array, columns: Array) -> tuple[Array, Array]:
    """Return one-step prediction errors of *columns* (n, k), divided by their relative deviation, and the deviation
    (n,).

    The first column is the record. The others (derivatives, regressors) pass through the same filter. The deviation is
    the standard deviation relative to that of the white noise.
    """
    E, S = _innovations(
        np.ascontiguousarray(t, dtype=np.float64),
        np.ascontiguousarray(columns, dtype=np.float64),
        law.omega,
        law.zeta,
        law.lag,
        law.rate,
        law.rho,
    )
    deviation = np.sqrt(S)
    return E / deviation[:, None], deviation


def cost(law: Oscillator | None, records: Sequence[Record]) -> float:
    """Return minus twice the log-likelihood of one signal's *records*, at the optimal noise level.

    The constant ``n (1 + log(2 pi))`` is left out. If *law* is None, the residual is white noise.
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
    """Return position and velocity/omega, (n,) each, of the oscillator excited by *push* (n,).

    It starts in equilibrium with the first push. Its damping ratio is at least :data:`DEAF`, because an undamped
    oscillator would explain any tone.
    """
    return rung(law.omega, max(law.zeta, DEAF), t, push)


def rung(omega: float, zeta: float, t: Array, push: Array) -> tuple[Array, Array]:
    """Return position and velocity/*omega*, (n,) each, of a spring and mass in equilibrium with the first *push*
    (n,)."""
    found = _driven(np.ascontiguousarray(t), np.ascontiguousarray(push), omega, zeta)
    return found[:, 0], found[:, 1]


@njit(cache=True)
def _transition(omega: float, zeta: float, dt: float) -> tuple[float, float, float, float]:
    """Return the transition matrix of (x, x'/omega) over *dt*, row by row."""
    damped = np.sqrt(1.0 - zeta * zeta)
    decay = np.exp(-zeta * omega * dt)
    c, s = np.cos(damped * omega * dt), np.sin(damped * omega * dt) / damped
    return decay * (c + zeta * s), decay * s, -decay * s, decay * (c - zeta * s)


@njit(cache=True)
def _lagged(omega: float, zeta: float, lag: float) -> tuple[float, float]:
    """Return the stationary covariances of z with x and with x'/omega, for x and x'/omega of unit variance."""
    # s (I/T - O') = (1/T, 0), O = [[0, omega], [-omega, -2 zeta omega]]
    a, d = 1.0 / lag, 1.0 / lag + 2.0 * zeta * omega
    det = a * d + omega * omega
    return a * d / det, -a * omega / det


@njit(cache=True)
def _step(omega: float, zeta: float, lag: float, dt: float, F: Array) -> None:
    """Fill *F* (3, 3) with the transition matrix of (x, x'/omega, z) over *dt*."""
    f00, f01, f10, f11 = _transition(omega, zeta, dt)
    e = np.exp(-dt / lag)
    # z less X (x, x'/omega) decays by itself, with X (O + I/T) = (1/T, 0)
    a, d = 1.0 / lag, 1.0 / lag - 2.0 * zeta * omega
    det = a * d + omega * omega
    X0, X1 = a * d / det, -a * omega / det
    F[0, 0], F[0, 1], F[0, 2] = f00, f01, 0.0
    F[1, 0], F[1, 1], F[1, 2] = f10, f11, 0.0
    F[2, 0], F[2, 1], F[2, 2] = X0 * f00 + X1 * f10 - e * X0, X0 * f01 + X1 * f11 - e * X1, e


@njit(cache=True)
def _innovations(
    t: Array, Y: Array, omega: float, zeta: float, lag: float, rate: bool, rho: float
) -> tuple[Array, Array]:
    n, k = Y.shape
    E, S = np.empty((n, k)), np.empty(n)
    s0, s1 = _lagged(omega, zeta, lag)
    scale = rho / (1.0 - s0 if rate else s0)
    stationary = scale * np.array([[1.0, 0.0, s0], [0.0, 1.0, s1], [s0, s1, s0]])
    P, x, g = stationary.copy(), np.zeros((3, k)), np.zeros(3)
    F, Q, A = np.eye(3), np.zeros((3, 3)), np.zeros((3, 3))
    first, third = (1.0, -1.0) if rate else (0.0, 1.0)
    last, s, settled = -1.0, 0.0, False
    for i in range(n):
        if i > 0:
            dt = t[i] - t[i - 1]
            if abs(dt - last) > 1e-9:
                _step(omega, zeta, lag, dt, F)
                last, settled = dt, False
                for a in range(3):
                    for b in range(3):
                        total = 0.0
                        for c in range(3):
                            total += F[a, c] * stationary[c, b]
                        A[a, b] = total
                for a in range(3):
                    for b in range(3):
                        Q[a, b] = stationary[a, b]
                        for c in range(3):
                            Q[a, b] -= A[a, c] * F[b, c]
            if not settled:
                for a in range(3):
                    for b in range(3):
                        A[a, b] = F[a, 0] * P[0, b] + F[a, 1] * P[1, b] + F[a, 2] * P[2, b]
                for a in range(3):
                    for b in range(3):
                        P[a, b] = Q[a, b] + A[a, 0] * F[b, 0] + A[a, 1] * F[b, 1] + A[a, 2] * F[b, 2]
            for j in range(k):
                x0, x1, x2 = x[0, j], x[1, j], x[2, j]
                x[0, j] = F[0, 0] * x0 + F[0, 1] * x1
                x[1, j] = F[1, 0] * x0 + F[1, 1] * x1
                x[2, j] = F[2, 0] * x0 + F[2, 1] * x1 + F[2, 2] * x2
        if not settled:
            before = s
            for a in range(3):
                g[a] = first * P[a, 0] + third * P[a, 2]
            s = max(first * g[0] + third * g[2], 0.0) + 1.0
            for a in range(3):
                for b in range(3):
                    P[a, b] -= g[a] * g[b] / s
            settled = i > SETTLED and abs(s - before) < 1e-12 * s
        S[i] = s
        for j in range(k):
            e = Y[i, j] - first * x[0, j] - third * x[2, j]
            E[i, j] = e
            for a in range(3):
                x[a, j] += g[a] / s * e
    return E, S


@njit(cache=True)
def _driven(t: Array, push: Array, omega: float, zeta: float) -> Array:
    out = np.zeros((len(t), 2))
    out[0, 0] = push[0]
    for i in range(1, len(t)):
        dt = t[i] - t[i - 1]
        f00, f01, f10, f11 = _transition(omega, zeta, dt)
        # A held push: it swings about where the push would hold it.
        x0, x1 = out[i - 1, 0] - push[i - 1], out[i - 1, 1]
        out[i, 0] = push[i - 1] + f00 * x0 + f01 * x1
        out[i, 1] = f10 * x0 + f11 * x1
    return out
