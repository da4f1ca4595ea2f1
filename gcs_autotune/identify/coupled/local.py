"""One local fit from the first successful start, with a delay if the evidence is strong."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.errors import NotInformative
from gcs_autotune.identify.problems.delay import SEARCHED_DELAYS, weigh_delay
from gcs_autotune.identify.problems.initial_guess import initial_guess_of
from gcs_autotune.identify.problems.least_squares import inverse_of
from gcs_autotune.identify.problems.likelihood import Limits, Objective
from gcs_autotune.identify.problems.problem import Problem
from gcs_autotune.identify.problems.reweighting import Effort
from gcs_autotune.identify.problems.solution import THOROUGH, Solution, solve_form
from gcs_autotune.identify.signals.segment import Segment
from gcs_autotune.models import Form

__all__ = ["Delayed", "LocalFit", "fit_with_delay", "local_fit"]

Array = NDArray[np.float64]

GOOD = 2.0
"""Noise of a fit, in multiples of each signal's roughness, below which no other start is tried. Project choice."""

HOPELESS = 10.0
"""Noise of a fit, in multiples of each signal's initial noise level, above which the fit counts as failed.

The runs are then cut into short pieces, and these are fitted. Project choice.
"""

SKETCH = Effort(15, exact=False, astray=HOPELESS)
"""Effort for the first fit from each start. Only the best of these fits is continued until it converges."""

MISFIT = Effort(25, exact=False)
"""Effort for the final fit if its residual is far above the noise.

More accuracy is useless if the model lacks a term.
"""

PATIENT = Effort(25, exact=False)
"""Effort for the fit from each start if the user allows whole runs only. The fit then continues whatever its residual.
"""

BETTER = 3.0
"""Factor by which the misfit of short pieces must be smaller than that of whole runs. Project choice.

Otherwise the fit over whole runs is kept.
"""


@dataclass(frozen=True, slots=True, eq=False)
class LocalFit:
    """A fit and the records it used.

    ``pieces``: whether the records were cut into pieces, because no fit over whole runs succeeded.
    """

    solution: Solution
    records: tuple[Segment, ...]
    pieces: bool = False


def local_fit(form: Form, records: Sequence[Segment], limits: Limits, *, robust: bool, whole: bool = False) -> LocalFit:
    """Return a fit of *form* that explains the records down to noise, or else the best fit.

    The fit is tried from several starts. A free run may diverge from the measured one because the craft is unstable,
    runs are of different craft, or a term is missing. The cost then has no useful minimum. The records are then cut
    into short pieces, each with its own initial state, unless *whole* runs are required.

    Raises
    ------
    NotInformative
        No model of this form can be simulated on these runs.
    """
    ground = initial_guess_of(form, records)
    best: Solution | None = None
    sketch = PATIENT if whole else SKETCH
    for theta in ground.starts(limits):
        solution = solve_form(
            form, records, theta, ground.initial, limits, levels=ground.levels, robust=robust, effort=sketch
        )
        if solution is None:
            continue
        agreed = best is not None and abs(solution.log_likelihood - best.log_likelihood) < 1.0
        if best is None or solution.log_likelihood > best.log_likelihood:
            best = solution
        if solution.converged and (agreed or _excess(solution, ground.rough) < GOOD):
            break
    if best is None or (not whole and _excess(best, ground.levels) > HOPELESS):
        pieces, initial = ground.pieces()
        sturdy = ground.sturdy(limits)
        begin = ground.regression.solve(sturdy)
        better = ground.on_pieces(begin, sturdy)
        begin = begin if better is None else better[0]
        cut = solve_form(form, pieces, begin, initial, limits, levels=ground.levels, robust=robust, effort=MISFIT)
        if cut is not None and (best is None or BETTER * _excess(cut, ground.levels) < _excess(best, ground.levels)):
            return LocalFit(cut, pieces, pieces=True)
    if best is None:
        raise NotInformative(
            f"no model '{form.name}' could be simulated on run '{records[0].run}', because the motion diverged from "
            "every start. Supply start values in the form, or check that inputs and outputs belong together"
        )
    effort = THOROUGH if _excess(best, ground.rough) < GOOD else MISFIT
    last = solve_form(form, records, best.theta, best.initial, limits, levels=best.noise, robust=robust, effort=effort)
    return LocalFit(best if last is None or last.log_likelihood < best.log_likelihood else last, tuple(records))


def _excess(solution: Solution, levels: Mapping[str, float]) -> float:
    """Return the largest ratio of a signal's fitted noise to its level in *levels*."""
    return max(solution.noise[n] / level for n, level in levels.items())


@dataclass(frozen=True, slots=True, eq=False)
class Delayed:
    """The chosen fit, and the evidence for a delay.

    ``evidence``: decrease of the Bayesian information criterion with a delay.
    """

    local: LocalFit
    evidence: float


def fit_with_delay(form: Form, records: Sequence[Segment], limits: Limits, *, robust: bool) -> Delayed:
    """Return the fit of *form*, with a delay if the evidence for one is strong.

    One Gauss-Newton step from zero delay estimates the possible gain. If there is no gain and the residuals are white,
    no delay is fitted. The fits without and with a delay use the same samples: those that do not depend on inputs
    before the record.
    """
    whole = tuple(records)
    plain = local_fit(form, whole, limits, robust=robust)
    solution = plain.solution
    hint, gain = _one_step(solution, plain.records)
    price = math.log(max(solution.samples, 2))
    if solution.white and gain < price:
        return Delayed(plain, gain - price)
    pairs: list[LocalFit] = []

    def fits(margin: float) -> tuple[Solution | None, Solution | None]:
        without = _again(plain, tuple(r.after(margin) for r in whole), limits, robust)
        if without is None:
            return None, None
        pairs.append(without)
        return without.solution, _lagged(form, without, limits, hint, robust)

    verdict = weigh_delay(fits)
    if verdict.kept and verdict.lagged is not None:
        return Delayed(LocalFit(verdict.lagged, pairs[-1].records, pairs[-1].pieces), verdict.evidence)
    return Delayed(plain, verdict.evidence)


def _again(plain: LocalFit, records: Sequence[Segment], limits: Limits, robust: bool) -> LocalFit | None:
    """Fit the same form to *records* that begin later, starting from the fit to the whole records."""
    if plain.pieces:
        return plain
    form, solution = plain.solution.form, plain.solution
    initial = initial_guess_of(form, records).initial
    refitted = solve_form(
        form, records, solution.theta, initial, limits, levels=solution.noise, robust=robust, effort=SKETCH
    )
    return None if refitted is None else LocalFit(refitted, tuple(records))


def _one_step(plain: Solution, records: Sequence[Segment]) -> tuple[float, float]:
    """Return the delay after one Gauss-Newton step from zero, and the predicted decrease of the cost."""
    form = plain.form.freeing("delay")
    theta = np.array([*plain.theta[: len(plain.form.free)], plain.shift, *plain.theta[len(plain.form.free) :]])
    objective = Objective(Problem(form, records, None, Limits({}, {})), theta, plain.initial)
    local = objective.at(objective.pack(), plain.noise_models)
    if local is None:
        return 0.0, 0.0
    step = -inverse_of(local.curvature) @ local.gradient
    at = form.free.index("delay")
    return plain.shift + float(step[at]), float(-local.gradient @ step)


def _lagged(form: Form, without: LocalFit, limits: Limits, hint: float, robust: bool) -> Solution | None:
    """Return the best fit with a delay.

    The starts are the delay *hint*, and a regression at each of :data:`SEARCHED_DELAYS`.
    """
    freed, plain, records = form.freeing("delay"), without.solution, without.records
    p = len(form.free)
    starts = [(np.array([*plain.theta[:p], max(hint, 0.02), *plain.theta[p:]]), plain.initial)]
    for delay in SEARCHED_DELAYS:
        ground = initial_guess_of(freed, records, delay)
        starts.append((ground.regression.solve(limits), ground.initial))
    scored = []
    for theta, initial in starts:
        objective = Objective(Problem(freed, records, None, limits), theta, initial)
        local = objective.at(objective.pack(), plain.noise_models)
        scored.append(np.inf if local is None else local.cost)
    best: Solution | None = None
    for i in np.argsort(scored)[:2]:
        if not np.isfinite(scored[i]):
            continue
        theta, initial = starts[i]
        solution = solve_form(freed, records, theta, initial, limits, levels=plain.noise, robust=robust, effort=SKETCH)
        if solution is not None and (best is None or solution.log_likelihood > best.log_likelihood):
            best = solution
    if best is None or best.log_likelihood <= plain.log_likelihood:
        return best
    effort = THOROUGH if best.white else MISFIT
    last = solve_form(freed, records, best.theta, best.initial, limits, levels=best.noise, robust=robust, effort=effort)
    return best if last is None or last.log_likelihood < best.log_likelihood else last
