"""Decide which drag structure the record supports, and how much this decision adds to the standard errors.

The criterion is the Bayesian information criterion (BIC) ``-2 log L / k + p log(n/k)``. ``k`` is the correlation time
of the residuals in samples (a quasi-likelihood correction), ``p`` the number of parameters, ``n`` that of samples.
Without the division by ``k``, coloured residuals would make any extra parameter look certain. The thresholds follow
Kass1995: a difference below 2 is undecided, 6 is strong evidence, 10 is very strong evidence.

The structure with both drags ("affine") contains each single drag as a special case. If the record does not decide, the
simpler structure is kept. Its single drag then includes part of the other drag. For example, a little quadratic drag
makes ``beta`` of a linear model too large by many standard errors. The standard errors are therefore raised, unless the
second drag is less than one standard error above zero. The raised value is ``std**2 = sum_k w_k (std_k**2 + (theta_k -
theta)**2)``, summed over both structures. The weights are ``w_k ~ exp(-AIC_k/2)`` (Buckland1997), in the squared form
of Burnham2002, section 4.3.

The weights use Akaike's criterion (AIC), whereas the choice uses the Bayesian one. The choice asks whether a term
improves the model. The weights ask whether omitting the term causes an error. If affine is chosen, no standard error is
raised, because its estimates are unbiased even if one drag is zero.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.identify.axis.form import Structure
from gcs_autotune.identify.axis.uncertainty import numbers_of, physical_covariance, std_of
from gcs_autotune.identify.problems.solution import Solution
from gcs_autotune.identify.result import Decision

__all__ = ["UNDECIDED", "choose", "craft_covariance", "damps", "disadvantage", "possible_second_drag"]

Array = NDArray[np.float64]

DRAG = ("a", "c")
"""Names of the linear and the quadratic drag parameter in :class:`.form.Explicit`."""

UNDECIDED = 2.0
"""Difference of the information criterion below which the choice of the drag structure is undecided (Kass1995).

The simpler structure is then kept. Of two equally simple structures, the linear one is kept.
"""


def choose(
    solutions: Mapping[Structure, Solution], criterion: Mapping[Structure, float], decision: Decision | None
) -> tuple[Structure, bool]:
    """Return the chosen structure, and whether linear and quadratic damping were too close to decide."""
    single: list[Structure] = [s for s in ("linear", "nonlinear") if s in solutions and damps(solutions[s])]
    if not single:
        single = [s for s in ("linear", "nonlinear") if s in solutions]
    if not single:
        return "affine", True
    best = min(single, key=lambda s: criterion[s])
    if _both_drags_are_real(solutions["affine"]) and criterion[best] - criterion["affine"] > UNDECIDED:
        return "affine", False
    if len(single) == 2 and abs(criterion["linear"] - criterion["nonlinear"]) < UNDECIDED:
        if decision is not None and decision.verdict != "undecided":
            return ("linear" if decision.verdict == "linear" else "nonlinear"), False
        return "linear", True
    return best, False


def disadvantage(solution: Solution, rival: Solution, correlation: float, penalty: float) -> float:
    """Return by how much the information criterion of *rival* exceeds that of *solution*.

    *penalty* is the cost of one parameter (2 in Akaike's criterion).
    """
    fit = 2.0 * (rival.log_likelihood - solution.log_likelihood) / correlation
    return penalty * (rival.unknowns - solution.unknowns) - fit


def possible_second_drag(
    chosen: Structure, solutions: Mapping[Structure, Solution], correlation: float
) -> Solution | None:
    """Return the affine solution if a single drag was *chosen* and a second drag is possible, else None.

    A second drag is possible if both fitted drags are positive and Akaike's criterion does not exclude the second one.
    """
    rival = solutions.get("affine")
    if chosen == "affine" or rival is None:
        return None
    if min(rival.value("a"), rival.value("c")) * rival.value("b") <= 0.0:
        return None
    return rival if disadvantage(solutions[chosen], rival, correlation, 1.0) < 0.0 else None


def craft_covariance(solution: Solution, rival: Solution | None, correlation: float) -> Array:
    """Return the covariance (5, 5) of (alpha, beta, beta_quadratic, delta, delay), with zero rows for fixed parameters.

    rival : solution with another structure that the record does not exclude, or None. Parameters in both solutions get
        the standard error given in the module's docstring. Correlations are unchanged.

    correlation : correlation time of the residuals [samples].
    """
    covariance = physical_covariance(solution)
    if rival is None:
        return covariance
    share = 1.0 / (1.0 + math.exp(0.5 * disadvantage(solution, rival, correlation, 2.0)))
    own, other = np.diag(covariance), np.diag(physical_covariance(rival))
    apart = numbers_of(rival).physical - numbers_of(solution).physical
    wanted = (1.0 - share) * own + share * (other + apart**2)
    both = (own > 0.0) & (other > 0.0)
    factors = np.where(both, np.sqrt(np.maximum(wanted, own) / np.where(both, own, 1.0)), 1.0)
    raised: Array = covariance * np.outer(factors, factors)
    return raised


def damps(solution: Solution) -> bool:
    """Return whether neither the linear nor the quadratic drag is negative by more than two standard errors."""
    return all(solution.value(n) >= -2.0 * std_of(solution, n, raised=False) for n in DRAG)


def _both_drags_are_real(solution: Solution) -> bool:
    """Return whether both drags are at least two standard errors above zero."""
    return all(solution.value(n) > 2.0 * std_of(solution, n) > 0.0 for n in DRAG)
