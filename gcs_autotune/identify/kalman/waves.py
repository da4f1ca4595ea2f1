"""Model waves as two states of a filter: a narrow-band force and an oscillation of the measured signal.

Both states are white noise filtered by ``s / (s^2 + 2 damping frequency s + frequency^2)`` (Fossen2011, chapter 8).
Both states have unit standard deviation. The first is proportional to the integral of the second. The second acts as a
force and appears in the signal. The filter has no gain at zero frequency, because a slow force is not a wave.

``waves`` (4,): standard deviations of the oscillation [m, rad] and of the force per inertia; frequency [rad/s]; damping
ratio. Between two stamps the force is held constant, as is the drifting force.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

__all__ = ["renew_waves", "rough", "turn_waves", "wave_transition", "waves_ahead"]

Array = NDArray[np.float64]


@njit(cache=True)
def rough(waves: Array) -> bool:
    """Return whether the model includes waves, from their parameters *waves* (4,)."""
    return bool(waves[0] > 0.0 or waves[1] > 0.0)


@njit(cache=True)
def wave_transition(waves: Array, h: float, F: Array) -> None:
    """Fill *F* (2, 2) with the exact transition of the wave states over *h* seconds."""
    omega, zeta = waves[2], waves[3]
    root = np.sqrt(1.0 - zeta * zeta)
    c, s, fade = np.cos(omega * root * h), np.sin(omega * root * h) / root, np.exp(-zeta * omega * h)
    F[0, 0], F[0, 1] = fade * (c + zeta * s), fade * s
    F[1, 0], F[1, 1] = -fade * s, fade * (c - zeta * s)


@njit(cache=True)
def turn_waves(vector: Array, matrix: Array, F: Array) -> None:
    """Apply the transition *F* (2, 2) to the wave states, in place.

    The wave states are the last two elements of *vector* (N,). The last two rows and columns of *matrix* (N, N) are
    transformed.
    """
    N = len(vector)
    a, b = N - 2, N - 1
    vector[a], vector[b] = F[0, 0] * vector[a] + F[0, 1] * vector[b], F[1, 0] * vector[a] + F[1, 1] * vector[b]
    for j in range(N):
        one, two = matrix[a, j], matrix[b, j]
        matrix[a, j], matrix[b, j] = F[0, 0] * one + F[0, 1] * two, F[1, 0] * one + F[1, 1] * two
    for j in range(N):
        one, two = matrix[j, a], matrix[j, b]
        matrix[j, a], matrix[j, b] = F[0, 0] * one + F[0, 1] * two, F[1, 0] * one + F[1, 1] * two


@njit(cache=True)
def renew_waves(cov: Array, F: Array) -> None:
    """Add the process noise of the waves over an interval with transition *F* to *cov* (N, N), in place.

    The noise replaces the variance that the stationary process loses over the interval.
    """
    a, b = len(cov) - 2, len(cov) - 1
    cov[a, a] += 1.0 - F[0, 0] * F[0, 0] - F[0, 1] * F[0, 1]
    cov[b, b] += 1.0 - F[1, 0] * F[1, 0] - F[1, 1] * F[1, 1]
    both = F[0, 0] * F[1, 0] + F[0, 1] * F[1, 1]
    cov[a, b] -= both
    cov[b, a] -= both


def waves_ahead(waves: Array, state: Array, after: Array) -> Array:
    """Return the expected second wave state (k,) at the times *after* (k,) [s], from the two states *state* (2,)."""
    F, expected = np.zeros((2, 2)), np.zeros(len(after))
    if rough(waves):
        for k, h in enumerate(after.tolist()):
            wave_transition(waves, h, F)
            expected[k] = F[1] @ state
    return expected
