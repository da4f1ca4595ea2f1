"""A narrow-band force on a craft, with white measurement noise: damped oscillator, the craft's lag, and a Kalman
filter. A slowly varying force can be part of the model.

The force is white noise through ``K s / (s^2 + 2 zeta omega s + omega^2)`` (Fossen2011, (8.118)). The velocity follows
the force with the craft's time constant, and the position is the integral of the velocity. Let ``x`` be the
oscillator's position and ``z`` its lagged value, ``T z' = x - z``. A measured position is ``z``, and a measured
velocity is ``x - z``, each with white noise. The discrete model is exact. If the model is right, the prediction errors
of the filter are white. The determinant of the covariance is the product of the variances of the prediction errors
(Harvey1989, section 3.4).

The slow force is the second-order drift of irregular waves. It follows the square of their envelope (Newman1974). For
an oscillator of damping ratio zeta, the autocorrelation of that square is ``exp(-2 zeta omega tau)``. The slow force is
therefore an Ornstein-Uhlenbeck process. Velocity and position follow it with the craft's lag. The position would not be
stationary, so it decays over the length of the record.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numba import njit
from numpy.typing import NDArray

__all__ = ["Oscillator", "Record", "cost", "driven", "rung", "whitened"]

Array = NDArray[np.float64]

Record = tuple[Array, Array]
"""Stamps (n,) [s] and residual (n,) of one signal of one run."""


DEAF = 0.03
"""Least damping ratio of an oscillator that the craft's own motion excites, see :func:`driven`. Project choice."""
APART = 1e-3
"""Least relative difference of the decay rates of slow force, velocity and position. Project choice."""
SETTLED = 20
"""Number of samples after which the filter's gain counts as stationary, for even stamps. Project choice."""


@dataclass(frozen=True, slots=True)
class Oscillator:
    """Model of the narrow-band oscillation in one signal.

    - ``omega`` [rad/s]: frequency.
    - ``zeta``: damping ratio, below 1.
    - ``lag`` [s]: time constant of the craft.
    - ``rho``: variance of the oscillation relative to that of the noise.
    - ``rate``: whether a velocity is measured, not a position.
    - ``slow``: variance of the velocity that the slow force would hold, in units of the velocity (or of the position
      over the lag), relative to the variance of the noise.
    - ``fade`` [1/s]: decay rate of the autocorrelation of the slow force.
    """

    omega: float
    zeta: float
    lag: float
    rate: bool
    rho: float
    slow: float = 0.0
    fade: float = 1.0

    @property
    def share(self) -> float:
        """Variance of the lagged position ``z``, relative to that of the oscillator's position ``x``.

        For a velocity the relative variance is one minus this value.
        """
        return _lagged(self.omega, self.zeta, self.lag)[0]

    def drifting(self, ratio: float) -> Oscillator:
        """Return the model with the drift of the waves: a slow force of *ratio* times the rms of their force."""
        seen = 1.0 - self.share if self.rate else self.share
        slow = (ratio * self.omega * self.lag) ** 2 * self.rho / seen
        return replace(self, slow=slow, fade=2.0 * self.zeta * self.omega)


def whitened(law: Oscillator, t: Array, columns: Array) -> tuple[Array, Array]:
    """Return one-step prediction errors of *columns* (n, k), divided by their relative deviation, and the deviation
    (n,). The first column is the record. The other columns (derivatives, regressors) pass through the same filter. The
    deviation is the standard deviation relative to that of the white noise.
    """
    E, S = _innovations(
        np.ascontiguousarray(t, dtype=np.float64),
        np.ascontiguousarray(columns, dtype=np.float64),
        law.omega,
        law.zeta,
        law.lag,
        law.rate,
        law.rho,
        law.slow,
        law.fade,
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
    """Return position and velocity/omega, (n,) each, of the oscillator *law* excited by *push* (n,) at the stamps *t*
    (n,).

    The oscillator starts in equilibrium with the first push. Its damping ratio is at least :data:`DEAF`, because an
    undamped oscillator would explain any tone.
    """
    return rung(law.omega, max(law.zeta, DEAF), t, push)


def rung(omega: float, zeta: float, t: Array, push: Array) -> tuple[Array, Array]:
    """Return position and velocity/*omega*, (n,) each, of a spring and mass that is excited by *push* (n,).

    The mass starts in equilibrium with the first push.
    """
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
def _wander(fade: float, lag: float, leak: float, dt: float, F: Array) -> None:
    """Fill the last three rows of *F* (6, 6) with the transition matrix of slow force, velocity and position over *dt*.

    Each decays at its own rate and drives the next. The rates must differ.
    """
    a, b, c = fade, 1.0 / lag, leak
    ea, eb, ec = np.exp(-a * dt), np.exp(-b * dt), np.exp(-c * dt)
    F[3, 3], F[4, 4], F[5, 5] = ea, eb, ec
    F[4, 3], F[5, 4] = b * (ea - eb) / (b - a), b * (eb - ec) / (c - b)
    F[5, 3] = b * b * (ea / ((b - a) * (c - a)) + eb / ((a - b) * (c - b)) + ec / ((a - c) * (b - c)))


@njit(cache=True)
def _stationary(omega: float, zeta: float, lag: float, rate: bool, rho: float, slow: float, rates: Array) -> Array:
    """Return the stationary covariance (3, 3) of the oscillator and its lag, or (6, 6) with the slow force."""
    s0, s1 = _lagged(omega, zeta, lag)
    scale = rho / (1.0 - s0 if rate else s0)
    P = np.zeros((6, 6) if slow > 0.0 else (3, 3))
    P[0, 0] = P[1, 1] = scale
    P[0, 2] = P[2, 0] = P[2, 2] = scale * s0
    P[1, 2] = P[2, 1] = scale * s1
    if slow > 0.0:
        a, b, c = rates
        P[3, 3] = slow
        P[3, 4] = P[4, 3] = P[4, 4] = slow * b / (a + b)
        P[3, 5] = P[5, 3] = b * P[3, 4] / (a + c)
        P[4, 5] = P[5, 4] = b * (P[3, 5] + P[4, 4]) / (b + c)
        P[5, 5] = b * P[4, 5] / c
    return P


@njit(cache=True)
def _innovations(
    t: Array, Y: Array, omega: float, zeta: float, lag: float, rate: bool, rho: float, slow: float, fade: float
) -> tuple[Array, Array]:
    n, k = Y.shape
    E, S = np.empty((n, k)), np.empty(n)
    rates = np.array([fade, 1.0 / lag, 1.0 / max(t[-1] - t[0], 1e-9)])
    for i in range(3):
        for j in range(i):
            if abs(rates[i] - rates[j]) < APART * rates[j]:
                rates[i] = (1.0 + 2.0 * APART) * rates[j]
    stationary = _stationary(omega, zeta, lag, rate, rho, slow, rates)
    m = len(stationary)
    P, x, g = stationary.copy(), np.zeros((m, k)), np.zeros(m)
    F, Q, A = np.eye(m), np.zeros((m, m)), np.zeros((m, m))
    seen = np.array([1.0, 0.0, -1.0, 0.0, 1.0, 0.0] if rate else [0.0, 0.0, 1.0, 0.0, 0.0, 1.0])[:m]
    last, s, settled = -1.0, 0.0, False
    for i in range(n):
        if i > 0:
            dt = t[i] - t[i - 1]
            if abs(dt - last) > 1e-9:
                _step(omega, zeta, lag, dt, F)
                if m > 3:
                    _wander(rates[0], 1.0 / rates[1], rates[2], dt, F)
                last, settled = dt, False
                _carried(F, stationary, A, Q)
                for a in range(m):
                    for b in range(m):
                        Q[a, b] = stationary[a, b] - Q[a, b]
            if not settled:
                _carried(F, P, A, P)
                for a in range(m):
                    for b in range(m):
                        P[a, b] += Q[a, b]
            for j in range(k):
                for first in range(0, m, 3):
                    x0, x1, x2 = x[first, j], x[first + 1, j], x[first + 2, j]
                    for a in range(first, first + 3):
                        x[a, j] = F[a, first] * x0 + F[a, first + 1] * x1 + F[a, first + 2] * x2
        if not settled:
            before = s
            s = 1.0
            for a in range(m):
                g[a] = 0.0
                for b in range(m):
                    g[a] += P[a, b] * seen[b]
            for a in range(m):
                s += seen[a] * g[a]
            s = max(s, 1.0)
            for a in range(m):
                for b in range(m):
                    P[a, b] -= g[a] * g[b] / s
            settled = i > SETTLED and abs(s - before) < 1e-12 * s
        S[i] = s
        for j in range(k):
            e = Y[i, j]
            for a in range(m):
                e -= seen[a] * x[a, j]
            E[i, j] = e
            for a in range(m):
                x[a, j] += g[a] / s * e
    return E, S


@njit(cache=True)
def _carried(F: Array, P: Array, A: Array, out: Array) -> None:
    """Fill *out* (m, m) with ``F P F'``. *F* consists of blocks (3, 3) on the diagonal. *A* (m, m) is overwritten."""
    m = len(P)
    for a in range(m):
        first = 3 * (a // 3)
        for b in range(m):
            A[a, b] = F[a, first] * P[first, b] + F[a, first + 1] * P[first + 1, b] + F[a, first + 2] * P[first + 2, b]
    for b in range(m):
        first = 3 * (b // 3)
        for a in range(m):
            out[a, b] = (
                A[a, first] * F[b, first] + A[a, first + 1] * F[b, first + 1] + A[a, first + 2] * F[b, first + 2]
            )


@njit(cache=True)
def _driven(t: Array, push: Array, omega: float, zeta: float) -> Array:
    out = np.zeros((len(t), 2))
    out[0, 0] = push[0]
    for i in range(1, len(t)):
        dt = t[i] - t[i - 1]
        f00, f01, f10, f11 = _transition(omega, zeta, dt)
        # A held push: it oscillates about where the push would hold it.
        x0, x1 = out[i - 1, 0] - push[i - 1], out[i - 1, 1]
        out[i, 0] = push[i - 1] + f00 * x0 + f01 * x1
        out[i, 1] = f10 * x0 + f11 * x1
    return out
