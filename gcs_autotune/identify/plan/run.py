"""Run a plan: fit its steps in order, validate them, fit all runs together, and collect doubts.

Each step passes the shared parameters on to the later ones.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.errors import NotInformative
from gcs_autotune.identify.api import fit
from gcs_autotune.identify.doubt import Doubt
from gcs_autotune.identify.free_run import Validation, validate
from gcs_autotune.identify.plan.combine import Agreement, Joint, Part, StepEstimate, agreements, combined, fit_jointly
from gcs_autotune.identify.plan.plan import Plan, PlanStep
from gcs_autotune.identify.result import Fit, Model, Parameter
from gcs_autotune.identify.signals.preparation import prepare_form
from gcs_autotune.models import CoupledModel, Form, unit_of
from gcs_autotune.notebook import Displayed
from gcs_autotune.rounding import format_value
from gcs_autotune.trial import Trial

__all__ = ["PlanResult", "StepResult", "plan_doubts", "run_plan"]


@dataclass(frozen=True, slots=True, eq=False)
class StepResult:
    """Result of one step of a plan.

    ``unseen``: whether the validation used runs that were not fitted.
    """

    step: PlanStep
    fit: Fit[Model]
    validation: Validation | None
    unseen: bool

    def to_dict(self) -> dict[str, Any]:
        """Return the result as data for JSON."""
        return {
            "name": self.step.name,
            "isolated": list(self.step.isolated),
            "shared": list(self.step.shared),
            "held": list(self.step.held),
            "fit": self.fit.to_dict(),
            "validation": None if self.validation is None else self.validation.to_dict(),
            "validated_on_unseen_runs": self.unseen,
        }


@dataclass(frozen=True, slots=True, eq=False)
class PlanResult(Displayed):
    """Result of a plan.

    - ``parameters``: estimates from the joint fit of all runs.
    - ``covariance`` (k, k): covariance of ``parameters``, in the same order.
    - ``combined``: name -> value before the joint fit, from the steps' estimates weighted by information.
    - ``agreements``: comparison of the steps' estimates, one per shared parameter.
    - ``model``: final form with the estimates.
    - ``final``: free run of ``model`` on runs that were not fitted.
    - ``skipped``: names of the steps without runs.
    """

    plan: Plan
    steps: tuple[StepResult, ...]
    parameters: Mapping[str, Parameter]
    covariance: NDArray[np.float64]
    combined: Mapping[str, float]
    agreements: tuple[Agreement, ...]
    model: CoupledModel | None
    final: Validation | None
    skipped: tuple[str, ...]
    doubts: tuple[Doubt, ...]

    def to_dict(self) -> dict[str, Any]:
        """Return the result as data for JSON."""
        return {
            "schema": 1,
            "plan": self.plan.name,
            "steps": [s.to_dict() for s in self.steps],
            "parameters": {
                n: {"value": p.value, "unit": p.unit, "std": p.std, "status": p.status}
                for n, p in self.parameters.items()
            },
            "covariance": self.covariance.tolist(),
            "combined": dict(self.combined),
            "agreements": [
                {
                    "name": a.name,
                    "steps": dict(zip(a.steps, a.values, strict=True)),
                    "stds": list(a.stds),
                    "combined": a.combined,
                    "plain_mean": a.mean,
                    "probability": a.probability,
                }
                for a in self.agreements
            ],
            "model": None if self.model is None else self.model.to_dict(),
            "final": None if self.final is None else self.final.to_dict(),
            "skipped": list(self.skipped),
            "doubts": [{"slug": d.slug, "cause": d.cause, "cure": d.cure} for d in self.doubts],
        }


Array = NDArray[np.float64]

SURE = 1e-3
"""Probability of a false alarm, over all shared parameters, below which steps are reported to disagree.

Project choice.
"""

TOGETHER = 0.98
"""Correlation above which two parameters are reported as correlated. Project choice."""

MISFIT = 1.3
"""Misfit per sample of the joint fit above which the steps' equations are reported as contradictory. Project choice."""


def plan_doubts(result: PlanResult, joint: Joint | None, unused: Sequence[str] = ()) -> tuple[Doubt, ...]:
    """Return the doubts about the whole plan. Doubts about a single step are in the fit of that step.

    joint : the fit of all runs.
    unused : names of runs that belong to no step.
    """
    plan, rows, doubts = result.plan, result.agreements, list[Doubt]()
    if unused:
        chosen = [*(s.chosen for s in plan.steps), *([] if plan.final is None else [plan.final.chosen])]
        manoeuvres = ", ".join(dict.fromkeys(name for c in chosen for name in c.manoeuvres))
        doubts.append(
            Doubt(
                "runs-of-no-step",
                f"{', '.join(unused)} belong{'s' if len(unused) == 1 else ''} to no step of plan '{plan.name}' and "
                "were not used",
                f'set "manoeuvre" in the side file to one of the plan\'s ({manoeuvres}), or list the runs in the plan',
            )
        )
    if result.skipped:
        missed = dict.fromkeys(n for s in plan.steps if s.name in result.skipped for n in (*s.isolated, *s.shared))
        lost = [n for n in missed if n not in result.parameters]
        doubts.append(
            Doubt(
                "steps-without-runs",
                f"no runs for {', '.join(result.skipped)}" + (f". Not identified: {', '.join(lost)}" if lost else ""),
                "fly these runs, and set the manoeuvre's name in the side file",
            )
        )
    for row in rows:
        if row.probability < SURE / len(rows):
            estimates = ", ".join(
                f"{s}: {format_value(v, e)}" for s, v, e in zip(row.steps, row.values, row.stds, strict=True)
            )
            doubts.append(
                Doubt(
                    "steps-disagree",
                    f"{row.name} differs between steps by more than its standard errors ({estimates})",
                    "look for a missing term in a step's equations, or a change of load or trim between the steps",
                )
            )
    if joint is None or not joint.converged:
        doubts.append(
            Doubt("joint-fit-failed", "the joint fit of all runs did not converge", "check the fit of each step first")
        )
    elif joint.misfit > MISFIT:
        doubts.append(
            Doubt(
                "joint-misfit",
                f"all runs together fit {joint.misfit:.2f} times worse than each step alone. One set of parameters "
                "does not explain all steps",
                "check the steps that disagree",
            )
        )
    doubts.extend(_together(result.parameters, result.covariance))
    fitted_on = [s.step.name for s in result.steps if not s.unseen]
    if fitted_on:
        doubts.append(
            Doubt(
                "validated-on-itself",
                f"steps with only one run have no held-out run for validation: {', '.join(fitted_on)}",
                "repeat",
            )
        )
    if plan.final is not None and result.final is None:
        doubts.append(
            Doubt(
                "no-final-validation",
                f"there is no usable run {plan.final.chosen}",
                "record a run of free driving and add it",
            )
        )
    return tuple(doubts)


def _together(parameters: Mapping[str, Parameter], covariance: Array) -> list[Doubt]:
    names = list(parameters)
    std = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    R = covariance / np.outer(std, std)
    pairs = [
        (names[i], names[j], float(R[i, j]))
        for i in range(len(names))
        for j in range(i + 1, len(names))
        if abs(R[i, j]) > TOGETHER
    ]
    return [
        Doubt(
            "move-together",
            f"{a} and {b} are correlated ({r:.3f}). The runs determine a combination of the two better than each one",
            "fly a manoeuvre that excites one without the other, or measure one of them ashore",
        )
        for a, b, r in pairs
    ]


def run_plan(plan: Plan, trials: Sequence[Trial]) -> PlanResult:
    """Identify all parameters of *plan* from *trials*, and return the result.

    Each step starts at the estimates of the earlier steps, combined by information. Parameters in ``held`` are fixed at
    these values. Then all steps' runs are fitted at once, and the whole model is simulated on the final runs.

    Raises
    ------
    NotInformative
        There is no run for any step, or a parameter in ``held`` has no value. It has no value if its step had no runs
        and the plan contains no a-priori value.
    MissingChannel, BadFile
        A run of a step lacks a channel that its form needs.
    """
    done: list[StepResult] = []
    used: list[tuple[PlanStep, tuple[Trial, ...]]] = []
    estimates: list[StepEstimate] = []
    skipped: list[str] = []
    values: dict[str, float] = dict(plan.start)
    for step in plan.steps:
        runs = step.chosen.of(trials)
        if not runs:
            skipped.append(step.name)
            continue
        result, own = _do(step, runs, values)
        done.append(result)
        used.append((step, own))
        estimate = _estimate(step, result.fit)
        if estimate is not None:
            estimates.append(estimate)
        names, best, _ = combined(estimates)
        values |= dict(zip(names, (float(v) for v in best), strict=True))
        values |= {
            step.global_name(n): result.fit.parameters[n].value
            for n in (*step.isolated, *step.shared, *step.local)
            if step.global_name(n) not in values
        }
    if not done:
        wanted = "; ".join(f"'{s.name}': runs {s.chosen}" for s in plan.steps)
        raise NotInformative(f"none of the runs belongs to a step of plan '{plan.name}' ({wanted})")
    seen = {n for step, _ in used for n in (*step.isolated, *step.shared)}
    parts = [_part(step, runs, r.fit, values, seen) for (step, runs), r in zip(used, done, strict=True)]
    joint = fit_jointly(parts, values)
    parameters, covariance = _parameters(plan, done, values, joint, estimates)
    model, final = _finally(plan, parameters, trials)
    ends = () if plan.final is None else plan.final.chosen.of(trials)
    meant = [*ends, *(run for step in plan.steps for run in step.chosen.of(trials))]
    unused = [run.name for run in trials if not any(run is other for other in meant)]
    outcome = PlanResult(
        plan=plan,
        steps=tuple(done),
        parameters=parameters,
        covariance=covariance,
        combined={n: values[n] for n in parameters},
        agreements=agreements(estimates),
        model=model,
        final=final,
        skipped=tuple(skipped),
        doubts=(),
    )
    return replace(outcome, doubts=plan_doubts(outcome, joint, unused))


def _do(step: PlanStep, runs: Sequence[Trial], values: Mapping[str, float]) -> tuple[StepResult, tuple[Trial, ...]]:
    """Return the fit and validation of one step, and the runs it fitted."""
    lost = [n for n in step.held if n not in values and n not in step.form.start]
    if lost:
        raise NotInformative(
            f"step '{step.name}' holds {', '.join(lost)}, but the step that identifies it has no runs. Fly that "
            "step, or supply an a-priori value in the plan's [start]"
        )
    kept = min(step.validate, len(runs) - 1)
    own = tuple(runs[: len(runs) - kept])
    start = {n: values.get(step.global_name(n), step.form.start.get(n, math.nan)) for n in step.form.free}
    form = step.form.fixing({n: start[n] for n in step.held})
    form = replace(form, start={n: v for n, v in start.items() if n in form.free and math.isfinite(v)})
    fitted = fit(own, form, step.method, delay=step.delay, use=step.signals or None)
    unseen = [_only_signals(t, form, step.signals) for t in (runs[-kept:] if kept else own[-1:])]
    try:
        local = validate(fitted.model, unseen)
    except NotInformative:
        local = None
    return StepResult(step, fitted, local, kept > 0), own


def _only_signals(trial: Trial, form: Form, signals: Sequence[str]) -> Trial:
    """Return the run with only the form's inputs and the chosen signals."""
    if not signals:
        return trial
    return replace(trial, channels={n: c for n, c in trial.channels.items() if n in form.inputs or n in signals})


def _estimate(step: PlanStep, fit: Fit[Model]) -> StepEstimate | None:
    """Return the estimates of a fit that other steps may use.

    Parameters at a bound and unobservable ones are left out.
    """
    order = list(fit.parameters)
    names = tuple(
        n
        for n in (*step.isolated, *step.shared)
        if fit.parameters[n].status == "fitted" and fit.parameters[n].std > 0.0
    )
    if not names:
        return None
    places = [order.index(n) for n in names]
    values = np.array([fit.parameters[n].value for n in names])
    return StepEstimate(step.name, names, values, fit.covariance[np.ix_(places, places)])


def _part(
    step: PlanStep, runs: Sequence[Trial], fit: Fit[Model], values: Mapping[str, float], seen: Collection[str]
) -> Part:
    """Return a step for the joint fit.

    Parameters that it held are free if a completed step identified them (*seen*).
    """
    known = {n: values.get(n, step.form.start.get(n, math.nan)) for n in step.held if n not in seen}
    form = step.form.fixing(known)
    form = form if step.delay == 0.0 else form.fixing({"delay": step.delay})
    records = tuple(r for run in runs for r in prepare_form(run, form, step.signals or None))
    return Part(form, tuple(step.global_name(n) for n in form.free), records, fit.noise)


def _parameters(
    plan: Plan,
    done: Sequence[StepResult],
    values: Mapping[str, float],
    joint: Joint | None,
    estimates: Sequence[StepEstimate],
) -> tuple[dict[str, Parameter], Array]:
    """Return the identified parameters and their covariance, from the joint fit.

    If that failed, they are combined from the steps.
    """
    if joint is not None:
        order, best, full = joint.names, joint.values, joint.covariance
    else:
        order, best, full = combined(estimates)
    names = [n for n in plan.parameters if n in order]
    places = [order.index(n) for n in names]
    units = {n: r.fit.parameters[n].unit for r in done for n in (*r.step.isolated, *r.step.shared)}
    covariance = full[np.ix_(places, places)]
    return {
        n: Parameter(n, float(best[at]), units.get(n) or unit_of(n, {}), math.sqrt(max(float(covariance[i, i]), 0.0)))
        for i, (n, at) in enumerate(zip(names, places, strict=True))
    }, covariance


def _finally(
    plan: Plan, parameters: Mapping[str, Parameter], trials: Sequence[Trial]
) -> tuple[CoupledModel | None, Validation | None]:
    """Return the final model, with the delay of the steps if all have the same, and its free run on the final runs."""
    final = plan.final
    if final is None:
        return None, None
    missing = [n for n in final.form.free if n not in parameters]
    if missing:
        return None, None
    delays = {step.delay for step in plan.steps}
    form = final.form if len(delays) > 1 or 0.0 in delays else final.form.fixing({"delay": max(delays)})
    model = CoupledModel(form, {n: parameters[n].value for n in form.free})
    runs = [_only_signals(t, final.form, final.signals) for t in final.chosen.of(trials)]
    try:
        return model, validate(model, runs) if runs else None
    except NotInformative:
        return model, None
