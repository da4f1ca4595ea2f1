"""Identification with effects, by output error: from runs and what is asked for to a :class:`Fit`.

The effects asked for come into the base model one after the other, each from every start and place.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.effects import EFFECTS, DataSummary, EffectInstance, ExtendedModel
from gcs_autotune.errors import NotInformative, UsageError
from gcs_autotune.identify.base_model import fit_base, given_base, plain_form
from gcs_autotune.identify.doubts import once
from gcs_autotune.identify.extended.effect_spec import EffectSpec
from gcs_autotune.identify.first_look import quanta_of
from gcs_autotune.identify.fitted import Fitted
from gcs_autotune.identify.free_numbers import label_of
from gcs_autotune.identify.preparation import prepare_as_recorded
from gcs_autotune.identify.problem import Problem
from gcs_autotune.identify.result import Doubt, Fit, Parameter, Status
from gcs_autotune.identify.reweighting import rounding_error
from gcs_autotune.identify.solution import Solution, fit_percent_of, solution_of, solve, traces_of
from gcs_autotune.identify.solution_doubts import effect_doubts, solution_doubts
from gcs_autotune.models import CoupledModel, Form, unit_of
from gcs_autotune.trial import Trial

__all__ = ["ExtendedCase", "fit_with_effects", "with_effects"]

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class ExtendedCase:
    """One question: these runs, this base and these effects, or a model to begin at and what to add to it.

    ``form`` of the base; the plain one for what the runs show (of ``dof``) when None. ``delay`` [s]: known, of all
    inputs; None: as the form has it. ``start``: its structure, effects and values are where the fit begins. ``robust``:
    soft-L1 weights.
    """

    runs: tuple[Trial, ...]
    form: Form | None = None
    specs: tuple[EffectSpec, ...] = ()
    start: ExtendedModel | None = None
    dof: str | None = None
    delay: float | None = None
    use: tuple[str, ...] | None = None
    robust: bool = False


def fit_with_effects(case: ExtendedCase) -> Fit:
    """Fit *case*; all of the base and of the effects together, each run with initial states of its own.

    Unlike other fits nothing is mended on the way in: units and signs may be among the effects asked for.

    Raises
    ------
    MissingChannel, BadFile, NotInformative
        The runs cannot be used, or no such model can be simulated on them.
    UsageError
        An effect these runs cannot show.
    """
    start = case.start
    form = start.base.form if start is not None else case.form or plain_form(case.runs, case.dof)
    if case.delay:
        form = form.fixing({"delay": case.delay})
    segments, doubts = prepare_as_recorded(case.runs, form, case.use)
    if start is None:
        problem, fitted = fit_base(form, segments)
    else:
        values = {**start.base.values, **form.known}
        base = CoupledModel(form, {n: values[n] for n in form.parameters})
        problem, _, fitted = given_base(base, start.effects, segments)
    fitted = with_effects(problem, fitted, case.specs)
    return _told(case, problem, fitted, _solution(case, problem, fitted), doubts)


def _solution(case: ExtendedCase, problem: Problem, fitted: Fitted) -> Solution:
    """Fit to the end as any other model: coarse sensors as rounding, outliers weighed when asked.

    Where a disturbance is learnt from what is left over (outliers, a jump of the compass) it stays as it was learnt,
    and the noise with it.

    Raises
    ------
    UsageError
        Weights against outliers, and a disturbance that explains them.
    """
    if any(EFFECTS[e.slug].is_disturbance for e in fitted.effects):
        if case.robust:
            raise UsageError("an effect that is learnt from what is left over explains outliers: leave --robust out")
        last = problem.fit(fitted.theta, fitted.effects, fitted.initial, shift=fitted.shift) or fitted
        return solution_of(problem, last)
    found = solve(
        problem,
        fitted.theta,
        fitted.initial,
        effects=fitted.effects,
        levels=fitted.levels,
        quanta=quanta_of(problem.segments),
        shift=fitted.shift,
        robust=case.robust,
    )
    return found or solution_of(problem, fitted)


def _told(case: ExtendedCase, problem: Problem, fitted: Fitted, solution: Solution, notes: Sequence[Doubt]) -> Fit:
    parameters, covariance = _parameters(problem.data_summary, solution)
    doubts = [*notes, *solution_doubts(solution), *effect_doubts(problem, fitted, parameters, solution.correlation)]
    base = CoupledModel(solution.form, dict(zip(solution.form.parameters, solution.theta.tolist(), strict=True)))
    model = ExtendedModel(
        base, solution.effects, amplitude=problem.data_summary.full, units=problem.data_summary.inputs
    )
    return Fit(
        dof="+".join(solution.form.dofs),
        structure=" + ".join((solution.form.name, *(f"{e.slug}@{e.place}" for e in solution.effects))),
        method="output-error",
        model=model if model.effects else model.base,
        parameters=parameters,
        covariance=covariance,
        fit_percent=fit_percent_of(solution),
        used=tuple(run.name for run in case.runs),
        noise=solution.noise,
        doubts=once(doubts),
        traces=traces_of(problem.segments, solution),
        extra={
            "signals": list(solution.noise),
            "inputs": dict(problem.data_summary.inputs),
            "swing": dict(problem.data_summary.full),
            "largest": dict(problem.data_summary.amplitude),
            "rounding": {n: rounding_error(solution.rests, n) for n in solution.noise},
            "std_inflation": float(solution.factors.max(initial=1.0)),
            "residual_correlation_time": solution.correlation,
            "log_likelihood": solution.log_likelihood,
            "time_shift": solution.shift,
            "quantum": dict(solution.quanta),
        },
    )


def _parameters(data_summary: DataSummary, solution: Solution) -> tuple[Mapping[str, Parameter], Array]:
    """Return all numbers with units, standard errors and Cramer-Rao bounds, and their covariance (p, p)."""
    form = solution.form
    normalised = form.normalised or set(data_summary.inputs.values()) == {"1"}
    values = dict(zip(form.parameters, solution.theta.tolist(), strict=True))
    units = {
        n: unit_of(n, data_summary.inputs, normalised=normalised, per_inertia=form.per_inertia) for n in form.parameters
    }
    learnt = []
    for own in solution.effects:
        entry = EFFECTS[own.slug]
        for name, value in own.values.items():
            label = label_of(own, name)
            values[label], units[label] = value, entry.unit_of(name, own.place, data_summary)
            if entry.is_disturbance:
                learnt.append(label)
    names = list(values)
    covariance = np.zeros((len(names),) * 2)
    places = [names.index(n) for n in solution.names]
    covariance[np.ix_(places, places)] = solution.raised_covariance
    bounds = dict(zip(solution.names, np.sqrt(np.diag(solution.whole)).tolist(), strict=False))
    parameters = {}
    for i, name in enumerate(names):
        status: Status = "fixed"
        if name in solution.names or name in learnt:
            status = "at_bound" if name in solution.at_bound else "fitted"
        std = float("nan") if name in learnt else float(np.sqrt(covariance[i, i]))
        parameters[name] = Parameter(name, values[name], units[name], std, status, bounds.get(name, float("nan")))
    return parameters, covariance


FIRST_TRIALS = 12
"""Steps of a start's first descent; the best is then fitted to the end."""

LAST_TRIALS = 60


def with_effects(problem: Problem, fitted: Fitted, specs: Sequence[EffectSpec]) -> Fitted:
    """Return *fitted* with every effect of *specs* added and all parameters fitted together.

    With two or more of them each is given a second chance from all its starts once the others are there, because
    the first to come may have taken what belongs to the later ones.

    Raises
    ------
    UsageError
        An effect these runs cannot show. NotInformative: the motion runs away with it from every start.
    """
    for spec in specs:
        fitted = _best(problem, fitted, fitted.effects, spec)
    if len(specs) > 1:
        for spec in specs:
            others = tuple(e for e in fitted.effects if not _meant(e, spec))
            again = _best(problem, fitted, others, spec)
            fitted = again if again.cost < fitted.cost else fitted
    return fitted


def _best(problem: Problem, fitted: Fitted, others: Sequence[EffectInstance], spec: EffectSpec) -> Fitted:
    best: Fitted | None = None
    taken = {(e.slug, e.place) for e in others}
    for own in spec.candidates(problem.data_summary):
        if (own.slug, own.place) in taken:
            continue
        found = problem.fit(fitted.theta, (*others, own), fitted.initial, trials=FIRST_TRIALS, shift=fitted.shift)
        if found is not None and (best is None or found.cost < best.cost):
            best = found
    final = None
    if best is not None:
        final = problem.fit(best.theta, best.effects, best.initial, trials=LAST_TRIALS, shift=best.shift)
    if final is None:
        raise NotInformative(f"no model with '{spec.slug}' can be simulated on these runs: leave it out")
    return final


def _meant(own: EffectInstance, spec: EffectSpec) -> bool:
    return own.slug == spec.slug and spec.place in (None, own.place)
