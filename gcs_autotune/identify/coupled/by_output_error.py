"""The method ``output-error`` for coupled models: start, delay, fit, what to doubt."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.identify.axis.by_output_error import fit_by_output_error
from gcs_autotune.identify.coupled.case import CoupledCase
from gcs_autotune.identify.coupled.limits import OPTIONS, horizon_of, limits_of
from gcs_autotune.identify.coupled.local import Delayed, LocalCost, fit_with_delay, local_fit
from gcs_autotune.identify.doubts import delay_fitted, once
from gcs_autotune.identify.first_look import quanta_of
from gcs_autotune.identify.likelihood import Limits
from gcs_autotune.identify.method import Method
from gcs_autotune.identify.odd_run import odd_run
from gcs_autotune.identify.problem import Problem
from gcs_autotune.identify.result import Doubt, Fit, Parameter, Status
from gcs_autotune.identify.reweighting import rounding_error
from gcs_autotune.identify.solution import fit_percent_of, solve, traces_of
from gcs_autotune.identify.solution_doubts import reversed_input, solution_doubts
from gcs_autotune.identify.stamp_correction import corrected
from gcs_autotune.models import CoupledModel, Form

__all__ = ["METHOD", "fit_coupled_by_output_error", "fit_of", "with_known_delay"]

Array = NDArray[np.float64]


def fit_coupled_by_output_error(case: CoupledCase) -> Fit:
    """Fit *case* by output error.

    Raises
    ------
    NotInformative
        No model of this form can be simulated on these runs.
    """
    form = with_known_delay(case.form, case.delay)
    limits = limits_of(form, case)
    if case.delay is None and "delay" not in form.parameters:
        chosen = fit_with_delay(form, case.records, limits, robust=case.robust)
    else:
        records = tuple(r.after(form.known.get("delay", 0.0)) for r in case.records)
        horizon = horizon_of(case)
        if horizon is not None:
            records = tuple(piece for record in records for piece in record.within(horizon))
        chosen = Delayed(local_fit(form, records, limits, robust=case.robust, whole=horizon is not None), 0.0)
    return fit_of(case, _finished(chosen, limits, robust=case.robust), limits, "output-error")


def _finished(chosen: Delayed, limits: Limits, *, robust: bool) -> Delayed:
    """Return the fit with changes of the inputs at the loops it points to, and coarse sensors taken as rounding."""
    local = chosen.local
    better = None if local.pieces else corrected(local.records, local.records, local.solution)
    segments = local.records if better is None else better
    quanta = quanta_of(segments)
    if better is None and not quanta:
        return chosen
    solution = local.solution
    found = solve(
        Problem(solution.form, segments, None, limits, solution.free),
        solution.theta,
        solution.initial,
        levels=solution.noise,
        quanta=quanta,
        shift=solution.shift,
        robust=robust,
    )
    return chosen if found is None else replace(chosen, local=replace(local, solution=found, records=segments))


def with_known_delay(form: Form, delay: float | None) -> Form:
    """Return *form* with this delay [s] known, unless there is none to speak of."""
    if delay is None or (delay == 0.0 and "delay" not in form.parameters):
        return form
    return form.fixing({"delay": delay})


def fit_of(
    case: CoupledCase, chosen: Delayed, limits: Limits, method: str, extra: Mapping[str, Any] | None = None
) -> Fit:
    """Return what was found, in the words of :class:`Fit`, with what to doubt about it; *extra* goes to its like."""
    solution, records = chosen.local.solution, chosen.local.records
    form, names = solution.form, solution.form.parameters
    units = dict(zip(form.inputs, case.records[0].input_units, strict=True))
    model = CoupledModel(form, dict(zip(names, solution.theta.tolist(), strict=True)))
    covariance, bounds = np.zeros((len(names),) * 2), {}
    places = [names.index(n) for n in solution.free]
    covariance[np.ix_(places, places)] = solution.raised_covariance
    for i, name in enumerate(solution.free):
        bounds[name] = float(np.sqrt(solution.whole[i, i]))
    parameters = {}
    for place, name in enumerate(names):
        status: Status = "fixed" if name not in solution.free else "at_bound" if name in solution.at_bound else "fitted"
        std = float(np.sqrt(covariance[place, place]))
        parameters[name] = Parameter(
            name,
            float(solution.theta[place]),
            form.unit_of(name, units),
            std,
            status,
            bounds.get(name, float("nan")),
        )
    return Fit(
        dof="+".join(form.dofs),
        structure=form.name,
        method=method,
        model=model,
        parameters=parameters,
        covariance=covariance,
        fit_percent=fit_percent_of(solution),
        used=case.names,
        noise=solution.noise,
        doubts=_doubts(case, chosen, limits),
        traces=traces_of(records, solution),
        extra={
            "signals": list(solution.noise),
            "rounding": {n: rounding_error(solution.rests, n) for n in solution.noise},
            "std_inflation": float(solution.factors.max(initial=1.0)),
            "residual_correlation_time": solution.correlation,
            "log_likelihood": solution.log_likelihood,
            "delay_evidence": chosen.evidence,
            "time_shift": solution.shift,
            "quantum": dict(solution.quanta),
            **(extra or {}),
        },
    )


def _doubts(case: CoupledCase, chosen: Delayed, limits: Limits) -> tuple[Doubt, ...]:
    """Return what is doubtful about the chosen fit, what the records already said first."""
    solution, records = chosen.local.solution, chosen.local.records
    notes = [doubt for record in case.records for doubt in record.notes]
    std = np.sqrt(np.maximum(np.diag(solution.raised_covariance), 0.0)).tolist()
    values = dict(zip(solution.form.parameters, solution.theta.tolist(), strict=True))
    of_its_own = (
        _pieces(chosen.local),
        reversed_input(solution.form, values, dict(zip(solution.free, std, strict=True))),
        delay_fitted(solution, chosen.evidence),
        odd_run(solution, records, limits),
    )
    return once([*notes, *solution_doubts(solution), *(d for d in of_its_own if d is not None)])


def _pieces(local: LocalCost) -> Doubt | None:
    if not local.pieces:
        return None
    longest = max(float(np.ptp(r.stamps)) for r in local.records)
    return Doubt(
        "short-horizon",
        f"no model of this form follows a whole run; it was fitted to pieces of {longest:.0f} s each",
        "look for a missing term, a run of another vehicle, or a craft that is course-unstable",
    )


METHOD = Method(
    "output-error",
    "simulated against measured motion, by maximum likelihood",
    axis=fit_by_output_error,
    coupled=fit_coupled_by_output_error,
    options=OPTIONS,
    bears=frozenset({"stamps", "rounding", "robust", "delay", "effects", "lever arm"}),
)
