"""Uncertainty of a fit of one degree of freedom in physical parameters."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.identify.axis.form import Explicit
from gcs_autotune.identify.problems.solution import Solution

__all__ = ["explicit_covariance", "numbers_of", "physical_covariance", "std_of"]

Array = NDArray[np.float64]


def numbers_of(solution: Solution) -> Explicit:
    """Return the explicit parameters of *solution*, a fit of one degree of freedom."""
    return Explicit(*solution.theta.tolist())


def physical_covariance(solution: Solution, *, raised: bool = True) -> Array:
    """Return the covariance (5, 5) of the physical parameters, zero for those not fitted.

    raised : whether to include the effect of coloured residuals.
    """
    G = numbers_of(solution).physical_slopes
    transformed: Array = G @ explicit_covariance(solution, raised=raised) @ G.T
    return transformed


def std_of(solution: Solution, name: str, *, raised: bool = True) -> float:
    """Return the standard error of the explicit parameter *name*, or 0 if it was not fitted.

    raised : whether to include the effect of coloured residuals.
    """
    if name not in solution.free:
        return 0.0
    at = solution.free.index(name)
    covariance = solution.raised_covariance if raised else solution.whole
    return float(np.sqrt(covariance[at, at]))


def explicit_covariance(solution: Solution, *, raised: bool = True) -> Array:
    """Return the covariance (5, 5) of the explicit parameters, zero for those not fitted.

    raised : whether to include the effect of coloured residuals.
    """
    names, k = solution.form.parameters, len(solution.free)
    covariance, places = np.zeros((len(names),) * 2), [names.index(n) for n in solution.free]
    covariance[np.ix_(places, places)] = solution.raised_covariance if raised else solution.whole[:k, :k]
    return covariance
