"""Model what differs from run to run: a constant force and the thrust.

A run has its own constant force ``b`` (mean wind, current, trim) and its own relative change of thrust ``s`` (battery,
load). Both have zero mean, and only their standard deviations are known. For a linear equation the innovations of a run
are ``e = e0 + A (b, s)``. ``e0`` are the innovations without ``b`` and ``s``. Each column of ``A`` is the filter's
response to one of the two forces. ``b`` and ``s`` are therefore integrated out after the filter, sample by sample
(DeJong1991). The filter needs no further states.

The spread between runs is estimated from the ``b`` and ``s`` of each run, about the mean of all runs. That mean is a
bias, which an effect has to explain.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from gcs_autotune.notebook import Displayed

__all__ = ["RunLikelihood", "RunLikelihoods", "RunOffset", "integrate_out"]

Array = NDArray[np.float64]

MOST_THRUST = 0.05
"""Largest standard deviation of thrust between runs, relative to the thrust.

The voltage of a battery falls by a sixth from full to empty, and thrust at one command falls by twice that. Runs of one
outing differ by less. With a larger spread, the effect of a nonlinear thrust curve on runs with different commands is
hidden. Example: for a saturation with process noise (seed 318), a spread of 0.1 reduces its log-likelihood gain from 16
to 7. Project choice.
"""


@dataclass(frozen=True, slots=True)
class RunOffset(Displayed):
    """Constant force per inertia and relative change of thrust of one run, with their standard errors."""

    run: str
    force: float
    force_std: float
    thrust: float
    thrust_std: float


@dataclass(frozen=True, slots=True, eq=False)
class RunLikelihood:
    """Log-likelihood of the constant force and thrust ``x`` (2,) of one run.

    It is ``h x - x G x / 2`` with ``h`` (2,) and ``G`` (2, 2).
    """

    run: str
    G: Array
    h: Array

    def day(self, force: float, thrust: float) -> RunOffset:
        """Return the estimated force and thrust change of the run, for a prior with zero mean.

        force, thrust : standard deviations of the prior.
        """
        P = np.diag([force**2, thrust**2])
        cov = P @ np.linalg.inv(np.eye(2) + self.G @ P)
        mean = cov @ self.h
        std = np.sqrt(np.maximum(np.diag(cov), 0.0))
        return RunOffset(self.run, float(mean[0]), float(std[0]), float(mean[1]), float(std[1]))


@njit(cache=True, nogil=True)
def integrate_out(A: Array, mean: Array, cov: Array, e: Array, S: Array) -> None:
    """Remove the run's own constant force ``b`` and change of thrust ``s`` from the innovations of one record, in
    place.

    A (2, s) : response of the innovations to each force of size one.
    e, S (s,) : innovations without these forces, and their variances. They are replaced by those of a filter to which
        (b, s) are unknown.
    mean (2,), cov (2, 2) : mean and covariance of (b, s) before the record, replaced by those after it.

    The innovation e0 + A' x has variance S about zero at the true x, so H = -A'.
    """
    for k in range(len(e)):
        a0, a1 = A[0, k], A[1, k]
        p0, p1 = cov[0, 0] * a0 + cov[0, 1] * a1, cov[1, 0] * a0 + cov[1, 1] * a1
        variance = S[k] + a0 * p0 + a1 * p1
        error = e[k] + a0 * mean[0] + a1 * mean[1]
        mean[0] -= p0 * error / variance
        mean[1] -= p1 * error / variance
        # P <- P - P A' A P / S, written as the sum of two positive parts: P / S' is small where a run is informative.
        cov[0, 0] -= p0 * p0 / variance
        cov[1, 1] -= p1 * p1 / variance
        cov[0, 1] -= p0 * p1 / variance
        cov[1, 0] = cov[0, 1]
        e[k], S[k] = error, variance


@dataclass(frozen=True, slots=True)
class RunLikelihoods:
    """Likelihoods of the constant force and thrust of all runs."""

    runs: tuple[RunLikelihood, ...]

    def offsets(self, force: float, thrust: float) -> tuple[RunOffset, ...]:
        """Return the constant force and the change of thrust of each run, for a prior with zero mean.

        force, thrust : standard deviations of the prior.
        """
        return tuple(one.day(force, thrust) for one in self.runs)

    def gain(self, force: float, thrust: float) -> float:
        """Return the gain in log-likelihood if the runs deviate in force and thrust from the best common value.

        It is relative to no constant force and no change of thrust.

        force, thrust : standard deviations of the deviations.
        """
        constant, q, Q = self._parts(force, thrust)
        return constant + 0.5 * float(q @ np.linalg.pinv(Q) @ q)

    def spread(self, least: float, widest: float, *, force: bool, thrust: bool) -> tuple[float, float]:
        """Return the standard deviations of force and thrust between runs, about the mean of all runs.

        The estimate is by restricted likelihood (Patterson1971), that is, after the mean is removed. With few runs the
        plain likelihood underestimates the spread.

        least, widest : limits of the standard deviation of the force [per inertia].
        force, thrust : whether force and thrust may differ between runs. If not, the standard deviation is *least* for
            the force and zero for the thrust.
        """
        best, likeliest = -math.inf, (least, 0.0)
        wide = force and widest > least
        forces = [least, *np.geomspace(max(least, 0.01 * widest), widest, 25)[1:]] if wide else [least]
        thrusts = [0.0, *(MOST_THRUST * np.geomspace(0.1, 1.0, 12))] if thrust else [0.0]
        for b in forces:
            for s in thrusts:
                constant, q, Q = self._parts(float(b), float(s))
                likelihood = constant + 0.5 * float(q @ np.linalg.pinv(Q) @ q) - 0.5 * float(np.linalg.slogdet(Q)[1])
                if likelihood > best:
                    best, likeliest = likelihood, (float(b), float(s))
        return likeliest

    def _parts(self, force: float, thrust: float) -> tuple[float, Array, Array]:
        """Return ``c``, ``q`` and ``Q`` of the log-likelihood ``c + q x - x Q x / 2`` of a common part ``x``.

        Runs deviate from it with standard deviations *force* and *thrust*.
        """
        P = np.diag([force**2, thrust**2])
        constant, q, Q = 0.0, np.zeros(2), np.zeros((2, 2))
        for one in self.runs:
            GP = np.eye(2) + one.G @ P
            B = P @ np.linalg.inv(GP)
            constant += 0.5 * float(one.h @ B @ one.h) - 0.5 * float(np.linalg.slogdet(GP)[1])
            q += one.h - one.G @ B @ one.h
            Q += one.G - one.G @ B @ one.G
        return constant, q, Q
