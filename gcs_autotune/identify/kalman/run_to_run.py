"""What differs from run to run: a constant force and the thrust of the day, each known by its spread alone.

A run has its own constant force ``b`` (mean wind, current, trim) and its own share ``s`` of thrust more (battery,
load), begun at zero mean. Under a linear equation its innovations are ``e = e0 + A (b, s)``: what the filter makes of
the record without them, and what it makes of either force alone. So both are integrated out beside the filter, sample
after sample (DeJong1991), and no state of it is more. How far runs differ is told by what each says of its own
``b`` and ``s``, about what they have in common: the common part is a bias, which is for an effect to explain.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

__all__ = ["Day", "RunSays", "common_gain", "integrate_out", "spread_between"]

Array = NDArray[np.float64]

MOST_THRUST = 0.05
"""Chosen: largest spread of thrust between days. A battery's voltage falls by a sixth from full to empty, and thrust at
one command by twice that; runs of one outing begin more alike. A larger one takes up what a bent thrust curve does to
runs of different commands (a saturation beneath weather, seed 318: of 16 in log-likelihood 0.1 left 7)."""


@dataclass(frozen=True, slots=True)
class Day:
    """What one run had of its own: constant force per inertia, share of thrust more, and their standard deviations."""

    run: str
    force: float
    force_std: float
    thrust: float
    thrust_std: float


@dataclass(frozen=True, slots=True, eq=False)
class RunSays:
    """What one run says of its constant force and thrust: log-likelihood ``h x - x G x / 2``, h (2,), G (2, 2)."""

    run: str
    G: Array
    h: Array

    def day(self, force: float, thrust: float) -> Day:
        """Return the estimate under zero means and these standard deviations."""
        P = np.diag([force**2, thrust**2])
        cov = P @ np.linalg.inv(np.eye(2) + self.G @ P)
        mean = cov @ self.h
        std = np.sqrt(np.maximum(np.diag(cov), 0.0))
        return Day(self.run, float(mean[0]), float(std[0]), float(mean[1]), float(std[1]))


@njit(cache=True, nogil=True)
def integrate_out(A: Array, mean: Array, cov: Array, e: Array, S: Array) -> None:
    """Take a run's own forces out of the innovations of one record, sample after sample.

    A (2, s) : what each force, at one, adds to the innovations. e, S (s,) : innovations without them and their
    variances; replaced by those of a filter that does not know (b, s). mean (2,), cov (2, 2) : of (b, s) before the
    record and, in place, after it. With the innovation e0 + A' x of variance S about zero at the true x: H = -A'.
    """
    for k in range(len(e)):
        a0, a1 = A[0, k], A[1, k]
        p0, p1 = cov[0, 0] * a0 + cov[0, 1] * a1, cov[1, 0] * a0 + cov[1, 1] * a1
        variance = S[k] + a0 * p0 + a1 * p1
        error = e[k] + a0 * mean[0] + a1 * mean[1]
        mean[0] -= p0 * error / variance
        mean[1] -= p1 * error / variance
        # P <- P - P A' A P / S, written as the sum of two positive parts: P / S' is small where a run tells much.
        cov[0, 0] -= p0 * p0 / variance
        cov[1, 1] -= p1 * p1 / variance
        cov[0, 1] -= p0 * p1 / variance
        cov[1, 0] = cov[0, 1]
        e[k], S[k] = error, variance


def _parts(says: Sequence[RunSays], force: float, thrust: float) -> tuple[float, Array, Array]:
    """Return the log-likelihood of deviations of these sizes about a common x, ``c + q x - x Q x / 2``: c, q, Q."""
    P = np.diag([force**2, thrust**2])
    constant, q, Q = 0.0, np.zeros(2), np.zeros((2, 2))
    for one in says:
        GP = np.eye(2) + one.G @ P
        B = P @ np.linalg.inv(GP)
        constant += 0.5 * float(one.h @ B @ one.h) - 0.5 * float(np.linalg.slogdet(GP)[1])
        q += one.h - one.G @ B @ one.h
        Q += one.G - one.G @ B @ one.G
    return constant, q, Q


def common_gain(says: Sequence[RunSays], force: float, thrust: float) -> float:
    """Return the log-likelihood that deviations of these sizes, about the best common part, gain over none at all."""
    constant, q, Q = _parts(says, force, thrust)
    return constant + 0.5 * float(q @ np.linalg.pinv(Q) @ q)


def spread_between(
    says: Sequence[RunSays], least: float, widest: float, *, force: bool, thrust: bool
) -> tuple[float, float]:
    """Return the standard deviations of force and thrust between runs, about what they have in common.

    By restricted likelihood (Patterson1971): that of what is left when the common part is taken out, for the few runs
    there are would make the plain one too small. least, widest : of the force [per inertia]; force, thrust : whether
    the force differs by more than the least, and thrust at all.
    """
    best, found = -math.inf, (least, 0.0)
    forces = [least, *np.geomspace(max(least, 0.01 * widest), widest, 25)[1:]] if force and widest > least else [least]
    thrusts = [0.0, *(MOST_THRUST * np.geomspace(0.1, 1.0, 12))] if thrust else [0.0]
    for b in forces:
        for s in thrusts:
            constant, q, Q = _parts(says, float(b), float(s))
            told = constant + 0.5 * float(q @ np.linalg.pinv(Q) @ q) - 0.5 * float(np.linalg.slogdet(Q)[1])
            if told > best:
                best, found = told, (float(b), float(s))
    return found
