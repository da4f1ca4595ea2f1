"""Which structure does the record speak for, and how sure can one be when it hardly does?

Evidence is the Bayesian information criterion with the likelihood tempered by the residuals' correlation time
``k`` (``-2 log L / k + p log(n/k)``, the quasi-likelihood correction): coloured residuals would otherwise make any
extra parameter look certain. Thresholds follow the scale of Kass1995: below 2 nothing is decided, 6
is strong, 10 very strong.

Both drags together ("affine") hold each drag alone as a special case. Where the second drag is not decided by the
record the simpler structure is kept, but its drag then carries what the other would have explained: a craft with a
little quadratic drag looks linear with too large a ``beta``, by many of its own standard errors. These are therefore
raised, unless the second drag is less than one standard error above zero, to

    ``std**2 = sum_k w_k (std_k**2 + (theta_k - theta)**2)``,  ``w_k ~ exp(-AIC_k/2)``

over both structures: the weights of Buckland1997, with the squared form of Burnham2002,
section 4.3. The weights are Akaike's, not those of the criterion that chooses: that one asks whether a
term is worth having, this whether leaving it out may hurt. Chosen affine, nothing is raised: its estimates are
unbiased whether or not one drag is really zero.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.identify.axis.form import Structure
from gcs_autotune.identify.axis.uncertainty import numbers_of, physical_covariance, std_of
from gcs_autotune.identify.result import Decision
from gcs_autotune.identify.solution import Solution

__all__ = ["UNDECIDED", "choose", "craft_covariance", "damps", "disadvantage", "possible_second_drag"]

Array = NDArray[np.float64]

DRAG = ("a", "c")
"""The numbers of linear and of quadratic drag."""

UNDECIDED = 2.0
"""Difference of the criterion below which nothing is decided: the simpler structure, or the linear one, is kept."""


def choose(
    solutions: Mapping[Structure, Solution], criterion: Mapping[Structure, float], decision: Decision | None
) -> tuple[Structure, bool]:
    """Return the structure, and whether linear and nonlinear were too close to call."""
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
    """Return by how much the *rival*'s criterion is larger, with *penalty* per parameter (2: Akaike's)."""
    fit = 2.0 * (rival.log_likelihood - solution.log_likelihood) / correlation
    return penalty * (rival.unknowns - solution.unknowns) - fit


def possible_second_drag(
    chosen: Structure, solutions: Mapping[Structure, Solution], correlation: float
) -> Solution | None:
    """Return the affine solution when a single drag was chosen and the other may well be there, else None."""
    rival = solutions.get("affine")
    if chosen == "affine" or rival is None:
        return None
    if min(rival.value("a"), rival.value("c")) * rival.value("b") <= 0.0:
        return None
    return rival if disadvantage(solutions[chosen], rival, correlation, 1.0) < 0.0 else None


def craft_covariance(solution: Solution, rival: Solution | None, correlation: float) -> Array:
    """Return the covariance (5, 5) of (alpha, beta, beta_quadratic, delta, delay), zero for what was not fitted.

    *rival* is another structure not excluded by the record: what both have in common gets the standard error of
    the module's formula; correlations stay as they are. *correlation* time of the residuals [samples].
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
    """Whether no drag is negative beyond two standard errors."""
    return all(solution.value(n) >= -2.0 * std_of(solution, n, raised=False) for n in DRAG)


def _both_drags_are_real(solution: Solution) -> bool:
    """Whether both drags damp and stand two standard errors above zero."""
    return all(solution.value(n) > 2.0 * std_of(solution, n) > 0.0 for n in DRAG)
