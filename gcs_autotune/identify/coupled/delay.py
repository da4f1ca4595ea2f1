"""Does the craft answer late? A delay is fitted and kept on strong evidence only, as for single axes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.identify.axis.structure import DELAY_EVIDENCE, FIRST_MARGIN, SEARCHED_DELAYS
from gcs_autotune.identify.coupled.initial_guess import initial_guess_of
from gcs_autotune.identify.coupled.local import MISFIT, SKETCH, Local, local_fit
from gcs_autotune.identify.least_squares import inverse_of
from gcs_autotune.identify.likelihood import Limits, Objective
from gcs_autotune.identify.problem import Problem
from gcs_autotune.identify.segment import Segment
from gcs_autotune.identify.solution import THOROUGH, Solution, solve_form
from gcs_autotune.models.coupled import Form

__all__ = ["Delayed", "fit_with_delay"]

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Delayed:
    """The fit chosen, and the evidence (difference of the criterion) for a delay."""

    local: Local
    evidence: float


def fit_with_delay(form: Form, records: Sequence[Segment], limits: Limits, *, robust: bool) -> Delayed:
    """Fit *form* without a delay, and with one where that may help.

    One Gauss-Newton step from no delay tells what a delay could gain at all; only then, or when the residuals are
    coloured, both are fitted to the same samples: those that do not answer to inputs from before the record.
    """
    whole = tuple(records)
    plain = local_fit(form, whole, limits, robust=robust)
    solution = plain.solution
    hint, gain = _one_step(solution, plain.records)
    price = math.log(max(solution.n, 2))
    if solution.white and gain < price:
        return Delayed(plain, gain - price)
    margin = FIRST_MARGIN
    while True:
        late = tuple(r.after(margin) for r in whole)
        without = _again(plain, late, limits, robust)
        if without is None:
            return Delayed(plain, 0.0)
        lagged = _lagged(form, without, limits, hint, robust)
        if lagged is None or lagged.value("delay") <= margin:
            break
        margin = 1.2 * lagged.value("delay")
    if lagged is None:
        return Delayed(plain, 0.0)
    correlation = lagged.correlation
    evidence = without.solution.bic(correlation) - lagged.bic(correlation)
    place = lagged.free.index("delay")
    std = math.sqrt(float(lagged.covariance[place, place]))
    if evidence > DELAY_EVIDENCE and lagged.value("delay") > 3.0 * std and "delay" not in lagged.at_bound:
        return Delayed(Local(lagged, without.records, without.pieces), evidence)
    return Delayed(plain, evidence)


def _again(plain: Local, records: Sequence[Segment], limits: Limits, robust: bool) -> Local | None:
    """Fit the same form to records that begin later, from where the fit to the whole ended."""
    if plain.pieces:
        return plain
    form, solution = plain.solution.form, plain.solution
    initial = initial_guess_of(form, records).initial
    found = solve_form(
        form, records, solution.theta, initial, limits, levels=solution.noise, robust=robust, effort=SKETCH
    )
    return None if found is None else Local(found, tuple(records))


def _one_step(plain: Solution, records: Sequence[Segment]) -> tuple[float, float]:
    """Return the delay of one Gauss-Newton step from none, and by how much the cost would fall."""
    form = plain.form.freeing("delay")
    theta = np.array([*plain.theta[: len(plain.form.free)], plain.shift, *plain.theta[len(plain.form.free) :]])
    objective = Objective(Problem(form, records, None, Limits({}, {})), theta, plain.initial)
    local = objective.at(objective.pack(), plain.models)
    if local is None:
        return 0.0, 0.0
    step = -inverse_of(local.curvature) @ local.gradient
    at = form.free.index("delay")
    return plain.shift + float(step[at]), float(-local.gradient @ step)


def _lagged(form: Form, without: Local, limits: Limits, hint: float, robust: bool) -> Solution | None:
    """Return the best fit with a delay, from the hint and from a regression at each of some delays."""
    freed, plain, records = form.freeing("delay"), without.solution, without.records
    p = len(form.free)
    starts = [(np.array([*plain.theta[:p], max(hint, 0.02), *plain.theta[p:]]), plain.initial)]
    for delay in SEARCHED_DELAYS:
        ground = initial_guess_of(freed, records, delay)
        starts.append((ground.regression.solve(limits), ground.initial))
    scored = []
    for theta, initial in starts:
        objective = Objective(Problem(freed, records, None, limits), theta, initial)
        local = objective.at(objective.pack(), plain.models)
        scored.append(np.inf if local is None else local.cost)
    best: Solution | None = None
    for i in np.argsort(scored)[:2]:
        if not np.isfinite(scored[i]):
            continue
        theta, initial = starts[i]
        found = solve_form(freed, records, theta, initial, limits, levels=plain.noise, robust=robust, effort=SKETCH)
        if found is not None and (best is None or found.log_likelihood > best.log_likelihood):
            best = found
    if best is None or best.log_likelihood <= plain.log_likelihood:
        return best
    effort = THOROUGH if best.white else MISFIT
    last = solve_form(freed, records, best.theta, best.initial, limits, levels=best.noise, robust=robust, effort=effort)
    return best if last is None or last.log_likelihood < best.log_likelihood else last
