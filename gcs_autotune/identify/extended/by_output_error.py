"""Fit a model with requested effects by output error, and return a :class:`Fit`.

The effects are added to the base model one after the other, each from every start and place.
"""

from __future__ import annotations

from collections.abc import Sequence

from gcs_autotune.effects import EFFECTS, DataSummary, EffectInstance, ExtendedModel
from gcs_autotune.errors import NotInformative, UsageError
from gcs_autotune.identify.case import Case
from gcs_autotune.identify.doubts import EffectTest, doubts_about
from gcs_autotune.identify.extended.effect_spec import EffectSpec
from gcs_autotune.identify.fit_builder import Motion, Table, fit_of, solution_extra, table_of
from gcs_autotune.identify.problems.base_model import fit_base, given_base
from gcs_autotune.identify.problems.fitted import Fitted
from gcs_autotune.identify.problems.problem import Problem
from gcs_autotune.identify.problems.quick_fit import quanta_of
from gcs_autotune.identify.problems.solution import Solution, solution_of, solve
from gcs_autotune.identify.result import Fit
from gcs_autotune.models import CoupledModel, unit_of

__all__ = ["fit_with_effects", "with_effects"]


def fit_with_effects(case: Case) -> Fit[CoupledModel | ExtendedModel]:
    """Return the fit of all parameters of the base model and of the effects of *case* together.

    Each run has its own initial states. Unlike in other fits, units and signs are not corrected first, because they may
    be among the requested effects.

    Raises
    ------
    NotInformative
        No such model can be simulated on these runs.
    UsageError
        A requested effect cannot be identified from these runs.
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
    """Fit until convergence, as for a model without effects.

    The rounding of coarse sensors enters the likelihood, and outliers are weighted if requested. A disturbance that was
    learnt from the residuals (outliers, a jump of the compass) stays unchanged, and so does the noise.

    Raises
    ------
    UsageError
        Robust weights are requested together with a disturbance that already explains outliers.
    """
    if any(EFFECTS[e.slug].is_disturbance for e in fitted.effects):
        if case.robust:
            raise UsageError(
                "--robust cannot be used with an effect fitted to the residuals, because that effect also explains "
                "outliers. Omit --robust"
            )
        last = problem.fit(fitted.theta, fitted.effects, fitted.initial, shift=fitted.shift) or fitted
        return solution_of(problem, last)
    solution = solve(
        problem,
        fitted.theta,
        fitted.initial,
        effects=fitted.effects,
        levels=fitted.levels,
        quanta=quanta_of(problem.segments),
        shift=fitted.shift,
        robust=case.robust,
    )
    return solution or solution_of(problem, fitted)


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
        doubts=doubts_about(solution, EffectTest(problem, fitted, table.parameters, solution.correlation)),
        extra={
            "signals": list(solution.noise),
            "inputs": dict(known.inputs),
            "swing": dict(known.full),
            "largest": dict(known.amplitude),
            **solution_extra(solution),
        },
    )


def _table(data_summary: DataSummary, solution: Solution) -> Table:
    """Return the table of all parameters with units, standard errors and Cramer-Rao bounds."""
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
            label = own.label_of(name)
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
"""Maximum number of steps of the first descent from each start.

Project choice. Only the best descent is continued until convergence.
"""

LAST_TRIALS = 60


def with_effects(problem: Problem, fitted: Fitted, specs: Sequence[EffectSpec]) -> Fitted:
    """Return *fitted* with every effect of *specs* added and all parameters fitted together.

    The first of several effects may have absorbed part of the later ones. Each is therefore fitted again from all its
    starts once the others are present.

    Raises
    ------
    UsageError
        One of the effects cannot be identified from these runs.
    NotInformative
        The motion with an effect diverges from every start.
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
        candidate = problem.fit(fitted.theta, (*others, own), fitted.initial, trials=FIRST_TRIALS, shift=fitted.shift)
        if candidate is not None and (best is None or candidate.cost < best.cost):
            best = candidate
    final = None
    if best is not None:
        final = problem.fit(best.theta, best.effects, best.initial, trials=LAST_TRIALS, shift=best.shift)
    if final is None:
        raise NotInformative(f"no model with '{spec.slug}' can be simulated on these runs. Omit this effect")
    return final


def _meant(own: EffectInstance, spec: EffectSpec) -> bool:
    return own.slug == spec.slug and spec.place in (None, own.place)
