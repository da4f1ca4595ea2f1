"""Identification with effects, by output error: from runs and what is asked for to a :class:`Fit`.

The effects asked for come into the base model one after the other, each from every start and place.
"""

from __future__ import annotations

from collections.abc import Sequence

from gcs_autotune.effects import EFFECTS, DataSummary, EffectInstance, ExtendedModel
from gcs_autotune.errors import NotInformative, UsageError
from gcs_autotune.identify.base_model import fit_base, given_base
from gcs_autotune.identify.case import Case
from gcs_autotune.identify.extended.effect_spec import EffectSpec
from gcs_autotune.identify.fit_builder import Motion, Table, fit_of, solution_extra, table_of
from gcs_autotune.identify.fitted import Fitted
from gcs_autotune.identify.free_numbers import label_of
from gcs_autotune.identify.problem import Problem
from gcs_autotune.identify.quick_fit import quanta_of
from gcs_autotune.identify.result import Fit
from gcs_autotune.identify.solution import Solution, solution_of, solve
from gcs_autotune.identify.solution_doubts import effect_doubts, solution_doubts
from gcs_autotune.models import CoupledModel, unit_of

__all__ = ["fit_with_effects", "with_effects"]


def fit_with_effects(case: Case) -> Fit[CoupledModel | ExtendedModel]:
    """Fit *case*; all of the base and of the effects together, each run with initial states of its own.

    Unlike other fits nothing is mended on the way in: units and signs may be among the effects asked for.

    Raises
    ------
    NotInformative
        No such model can be simulated on these runs.
    UsageError
        An effect these runs cannot show.
    """
    form, start = case.the_form, case.start
    if start is None:
        problem, fitted = fit_base(form, case.records)
    else:
        values = {**start.base.values, **form.known}
        base = CoupledModel(form, {n: values[n] for n in form.parameters})
        problem, _, fitted = given_base(base, start.effects, case.records)
    fitted = with_effects(problem, fitted, case.effects)
    return _outcome(case, problem, fitted, _solution(case, problem, fitted))


def _solution(case: Case, problem: Problem, fitted: Fitted) -> Solution:
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


def _outcome(case: Case, problem: Problem, fitted: Fitted, solution: Solution) -> Fit[CoupledModel | ExtendedModel]:
    table, known = _table(problem.data_summary, solution), problem.data_summary
    model = ExtendedModel(solution.base, solution.effects, amplitude=known.full, units=known.inputs)
    return fit_of(
        case,
        "output-error",
        model if model.effects else model.base,
        table,
        Motion.of_solution(problem.segments, solution),
        structure=" + ".join((solution.form.name, *(f"{e.slug}@{e.place}" for e in solution.effects))),
        doubts=[
            *solution_doubts(solution),
            *effect_doubts(problem, fitted, table.parameters, solution.correlation),
        ],
        extra={
            "signals": list(solution.noise),
            "inputs": dict(known.inputs),
            "swing": dict(known.full),
            "largest": dict(known.amplitude),
            **solution_extra(solution),
        },
    )


def _table(data_summary: DataSummary, solution: Solution) -> Table:
    """Return all numbers with units, standard errors and Cramer-Rao bounds."""
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
    return table_of(
        values,
        units,
        solution.names,
        solution.raised_covariance,
        bounds=solution.bounds,
        status=dict.fromkeys(solution.at_bound, "at_bound"),
        unknown=learnt,
    )


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
