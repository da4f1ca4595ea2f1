"""The method ``global``: two global optimisers with the same cost, and output error from the better of the two results.

Source: Erunsal2017, section 3.4. One optimiser is differential evolution (Storn1997). The other samples the box evenly
and descends from its best samples with exact derivatives. Both simulate whole runs from the smoothed first states. The
cost is the concentrated Gaussian log-likelihood, so neither units nor noise levels need to be known.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import Bounds, differential_evolution

from gcs_autotune.errors import NotInformative, UsageError
from gcs_autotune.identify.case import Case
from gcs_autotune.identify.coupled.by_output_error import outcome, with_known_delay
from gcs_autotune.identify.coupled.limits import LONGEST_DELAY, limits_of
from gcs_autotune.identify.coupled.limits import OPTIONS as LIMIT_OPTIONS
from gcs_autotune.identify.coupled.local import Delayed, LocalFit, local_fit
from gcs_autotune.identify.coupled.one_axis import for_axis
from gcs_autotune.identify.method import Method
from gcs_autotune.identify.problems.initial_guess import InitialGuess, initial_guess_of
from gcs_autotune.identify.problems.least_squares import descend
from gcs_autotune.identify.problems.likelihood import Limits, Objective
from gcs_autotune.identify.problems.noise import gaussian_noise
from gcs_autotune.identify.problems.problem import Problem
from gcs_autotune.identify.problems.reweighting import likeliest
from gcs_autotune.identify.problems.solution import Solution, solve_form
from gcs_autotune.identify.result import Fit
from gcs_autotune.identify.signals.segment import Segment
from gcs_autotune.models import CoupledModel, Form, Simulator, inertia_of
from gcs_autotune.slow_imports import scipy_stats

__all__ = ["METHOD", "OPTIONS", "Box", "Searched", "box_of", "fit_by_global_search", "search"]

Array = NDArray[np.float64]

WIDTH = 4.0
"""Half-width of the search box, in units of a parameter's scale. Project choice.

The scale of a parameter is the value at which its term is as large as the known forces.
"""

MOST_RUNAWAY = 50.0
"""Cost per sample assigned to a diverging motion.

It is higher than any cost of a simulation that does not diverge. Project choice.
"""

PATIENCE = 15
"""Maximum number of integration steps per stamp. Project choice.

A model that needs more is too stiff for the sampling and is rejected.
"""

SHARE_SAMPLED = 0.5
"""Fraction of the multi-start optimiser's budget that is spent on evenly spread samples. Project choice.

The descents from the best samples get the rest of the budget.
"""

DESCENTS, TRIALS = 6, 20
"""Number of best samples from which a descent starts, and maximum number of trials of each descent. Project choice."""


@dataclass(frozen=True, slots=True, eq=False)
class Box:
    """Search region of the free parameters ``names``: limits ``low`` and ``high`` (f,) in the form's order."""

    names: tuple[str, ...]
    low: Array
    high: Array


@dataclass(frozen=True, slots=True, eq=False)
class Searched:
    """Result of the better of the two global optimisers.

    - ``theta`` (p,): parameters.
    - ``winner``: name of the better optimiser.
    - ``costs``: name of the optimiser -> its lowest cost (minus twice the log-likelihood).
    - ``evaluations``: name of the optimiser -> number of simulations of all records.
    """

    theta: Array
    winner: str
    costs: dict[str, float]
    evaluations: dict[str, int]

    @property
    def margin(self) -> float:
        """Difference between the lowest costs of the two optimisers (minus twice the log-likelihood), at least 0."""
        return max(self.costs.values()) - min(self.costs.values())


def box_of(ground: InitialGuess, limits: Limits) -> Box:
    """Return a wide search box for the free parameters of the form in *ground*, cut to *limits*.

    The size of the box follows from the forces and motions in the runs. Inertia is positive.
    """
    form, scales = ground.form, dict(zip(ground.regression.names, ground.regression.scales, strict=True))
    speed = max(float(np.max(np.abs(m.X))) for m in ground.motions)
    wide = {"delay": LONGEST_DELAY, "lag": LONGEST_DELAY, "V_x": speed, "V_y": speed}
    low, high = [], []
    natural = Limits.physical(form)
    for name in form.free:
        half = wide.get(name) or WIDTH * (scales.get(name) or abs(form.start.get(name, 0.0)) or 1.0)
        least, most = -half, half
        inertia = inertia_of(name) if name.endswith("dot") else None
        if (inertia is not None and inertia.row == inertia.column) or name in natural.low:
            least, most = (-half, -1e-3 * half) if name in natural.high else (1e-3 * half, half)
        least, most = max(least, limits.low.get(name, -np.inf)), min(most, limits.high.get(name, np.inf))
        low.append(least if least < most else limits.low.get(name, most - half))
        high.append(most if least < most else limits.high.get(name, least + half))
    return Box(tuple(form.free), np.array(low), np.array(high))


def search(ground: InitialGuess, box: Box, *, budget: int, seed: int) -> Searched:
    """Search *box* with both optimisers and return the better result.

    budget : simulations of all records; each optimiser may use half.
    """
    cost = _Cost(ground)
    optima = {}
    evaluations = {}
    for name, optimiser in (("differential evolution", _evolved), ("multi-start", _multi_start)):
        cost.spent = 0
        optima[name] = optimiser(cost, box, budget // 2, seed)
        evaluations[name] = cost.spent
    costs = {name: cost(values) for name, values in optima.items()}
    winner = min(costs, key=lambda name: costs[name])
    return Searched(cost.theta(optima[winner]), winner, costs, evaluations)


@dataclass(slots=True, eq=False)
class _Cost:
    """Minus twice the log-likelihood as a function of the free parameters.

    Noise levels are optimal at every point. The initial states are the smoothed ones.
    """

    ground: InitialGuess
    spent: int = 0
    simulator: Simulator = field(init=False)
    objective: Objective = field(init=False)

    def __post_init__(self) -> None:
        g = self.ground
        self.simulator = Simulator(g.form, patience=PATIENCE)
        self.objective = Objective(
            Problem(g.form, [replace(r, dating=0.0) for r in g.records], None, Limits({}, {})),  # polished later
            g.regression.theta,
            g.initial,
            fixed_states=True,
            patience=PATIENCE,
        )

    def theta(self, values: Array) -> Array:
        """Return all parameters (p,) of the form, with the free ones set to *values*."""
        return self.objective.unpack(values)[0]

    def __call__(self, values: Array) -> float:
        """Return the cost at the free parameters *values* (f,), without derivatives."""
        self.spent += 1
        theta, g = self.theta(values), self.ground
        squares = dict.fromkeys(g.rough, 0.0)
        counts = dict.fromkeys(g.rough, 0)
        for record, x_0 in zip(g.records, g.initial, strict=True):
            stamps = record.stamps
            motion = self.simulator.run(theta, x_0, record.t_in, record.inputs, stamps, sensitivities=False)
            if motion is None:
                return MOST_RUNAWAY * sum(len(s.t) for r in g.records for s in r.signals.values())
            for name, signal in record.signals.items():
                value, _ = self.simulator.outputs(theta, *motion, name)
                error = signal.values - value[np.searchsorted(stamps, signal.t)]
                squares[name] += float(error @ error)
                counts[name] += len(error)
        shares = {name: max(squares[name] / n, (0.1 * g.rough[name]) ** 2) for name, n in counts.items()}
        return float(sum(n * math.log(shares[name] / g.rough[name] ** 2) for name, n in counts.items()))


def _evolved(cost: _Cost, box: Box, budget: int, seed: int) -> Array:
    """Return the free parameters after differential evolution with as many generations as *budget* allows."""
    size = max(5, min(15, budget // (20 * len(box.names))))
    generations = max(1, budget // (size * len(box.names)) - 1)
    optimum = differential_evolution(
        cost,
        Bounds(box.low, box.high),
        popsize=size,
        maxiter=generations,
        rng=np.random.default_rng(seed),
        polish=False,
        init="sobol",
        tol=1e-6,
    )
    return np.asarray(optimum.x, dtype=np.float64)


def _multi_start(cost: _Cost, box: Box, budget: int, seed: int) -> Array:
    """Return the best free parameters after even sampling of the box and descents from the best samples."""
    sampled = max(8, int(SHARE_SAMPLED * budget))
    cube = scipy_stats().qmc.LatinHypercube(len(box.names), rng=np.random.default_rng(seed)).random(sampled)
    points = box.low + cube * (box.high - box.low)
    costs = np.array([cost(p) for p in points])
    best: Array = points[int(np.argmin(costs))]
    least = float(costs.min())
    for start in points[np.argsort(costs)[:DESCENTS]]:
        if cost.spent >= budget:
            break
        end = _descended(cost, start, box)
        at_end = cost(end)
        if at_end < least:
            best, least = end, at_end
    return best


def _descended(cost: _Cost, start: Array, box: Box) -> Array:
    """Return the end of a descent from *start*, with weights updated from the residuals.

    The weight of each signal follows its residual at the start, then at the end of each of three descents.
    """
    x = start
    for _ in range(3):
        residuals = cost.objective.residuals(x)
        cost.spent += 1
        if residuals is None:
            return x
        laws = likeliest(residuals, gaussian_noise(cost.ground.levels))
        minimum = descend(partial(cost.objective.at, noise=laws), x, box.low, box.high, trials=TRIALS)
        if minimum is None:
            return x
        cost.spent += minimum.iterations
        x = minimum.x
    return x


BUDGET = 150
"""Default budget of both searches together: number of simulations of all records per free parameter. Project choice."""

LEAST = 50
"""Smallest budget that is accepted [simulations of all records]. A smaller one raises UsageError. Project choice."""

OPTIONS = (
    *LIMIT_OPTIONS,
    ("budget", f"number of simulations of the search (default: {BUDGET} per free parameter)"),
    ("seed", "seed of the random numbers. The same seed gives the same result"),
)
"""Options of ``fit`` that this method reads, with a line of help each."""


def fit_by_global_search(case: Case) -> Fit[CoupledModel]:
    """Return the fit of *case* that starts at the better result of two global searches.

    An unknown delay counts as zero unless it is free in the form. Start values of the form are not used. The local fit
    from the regression's start is kept if it is better.

    ``extra["search"]`` contains the winning optimiser, its margin in minus twice the log-likelihood, and the number of
    simulations of each optimiser. It also contains the gain in log-likelihood over the local fit. A negative gain means
    that the local fit was kept.

    Raises
    ------
    NotInformative
        No model of this form can be simulated on these runs.
    """
    form = replace(with_known_delay(case.the_form, case.delay), start={})
    seed = int(case.options.get("seed", 0))
    budget = int(case.options.get("budget", BUDGET * len(form.free)))
    if budget < LEAST:
        raise UsageError(f"a budget of {budget} simulations is too small. Use {LEAST} or more")
    limits = limits_of(form, case)
    records = tuple(r.after(form.known.get("delay", 0.0)) for r in case.records)
    ground = initial_guess_of(form, records)
    searched = search(ground, box_of(ground, limits), budget=budget, seed=seed)
    polished = solve_form(
        form, records, searched.theta, ground.initial, limits, levels=ground.levels, robust=case.robust
    )
    if polished is None:
        raise NotInformative(
            f"no model '{form.name}' could be simulated on run '{records[0].run}'. Both global searches found only "
            "diverging motions. Narrow the bounds or increase the budget"
        )
    summary = {
        "winner": searched.winner,
        "margin": searched.margin,
        "costs": searched.costs,
        "evaluations": searched.evaluations,
    }
    plain = _from_regression(form, records, limits, robust=case.robust)
    ahead = math.nan if plain is None else polished.log_likelihood - plain.log_likelihood
    if plain is not None and ahead < 0.0:
        polished = plain
    extra = {"search": {**summary, "ahead_of_local": ahead}}
    return outcome(case, Delayed(LocalFit(polished, records), 0.0), limits, "global", extra)


def _from_regression(form: Form, records: Sequence[Segment], limits: Limits, *, robust: bool) -> Solution | None:
    """Return the local fit from the regression's start, or None if it fails.

    With many parameters an affordable search does not come near this fit.
    """
    try:
        local = local_fit(form, records, limits, robust=robust, whole=True)
    except NotInformative:
        return None
    return local.solution


METHOD = Method(
    "global",
    "output error, started from the better of two global searches",
    axis=for_axis(fit_by_global_search),
    coupled=fit_by_global_search,
    options=OPTIONS,
    bears=frozenset({"stamps", "robust", "lever arm"}),
)
