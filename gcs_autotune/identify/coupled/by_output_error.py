"""The method ``output-error`` for coupled models: start, delay, fit, doubts."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.identify.axis.by_output_error import fit_by_output_error
from gcs_autotune.identify.case import Case
from gcs_autotune.identify.coupled.limits import OPTIONS, horizon_of, limits_of
from gcs_autotune.identify.coupled.local import Delayed, fit_with_delay, local_fit
from gcs_autotune.identify.coupled.one_axis import for_axis
from gcs_autotune.identify.doubt import Doubt
from gcs_autotune.identify.doubts import FittedDelay, Gains, doubts_about
from gcs_autotune.identify.fit_builder import Motion, fit_of, form_table, solution_extra
from gcs_autotune.identify.method import Method
from gcs_autotune.identify.outlier_run import outlier_run
from gcs_autotune.identify.problems.likelihood import Limits
from gcs_autotune.identify.problems.problem import Problem
from gcs_autotune.identify.problems.quick_fit import quanta_of
from gcs_autotune.identify.problems.solution import solve
from gcs_autotune.identify.problems.stamp_correction import corrected
from gcs_autotune.identify.result import AxisFit, Fit
from gcs_autotune.models import CoupledModel, Form

__all__ = ["METHOD", "fit_coupled_by_output_error", "outcome", "with_known_delay"]

Array = NDArray[np.float64]


def fit_coupled_by_output_error(case: Case) -> Fit[CoupledModel]:
    """Return the output-error fit of *case*, with a delay if the evidence for one is strong.

    Raises
    ------
    NotInformative
        No model of this form can be simulated on these runs.
    """
    form = with_known_delay(case.the_form, case.delay)
    limits = limits_of(form, case)
    if case.delay is None and "delay" not in form.parameters:
        chosen = fit_with_delay(form, case.records, limits, robust=case.robust)
    else:
        records = tuple(r.after(form.known.get("delay", 0.0)) for r in case.records)
        horizon = horizon_of(case)
        if horizon is not None:
            records = tuple(piece for record in records for piece in record.within(horizon))
        chosen = Delayed(local_fit(form, records, limits, robust=case.robust, whole=horizon is not None), 0.0)
    return outcome(case, _finished(chosen, limits, robust=case.robust), limits, "output-error")


def _finished(chosen: Delayed, limits: Limits, *, robust: bool) -> Delayed:
    """Return the fit after two refinements.

    Input changes are moved to the autopilot loop that the fit indicates. The rounding of coarse sensors enters the
    likelihood.
    """
    local = chosen.local
    better = None if local.pieces else corrected(local.records, local.records, local.solution)
    segments = local.records if better is None else better
    quanta = quanta_of(segments)
    if better is None and not quanta:
        return chosen
    solution = local.solution
    refined = solve(
        Problem(solution.form, segments, None, limits, solution.free),
        solution.theta,
        solution.initial,
        levels=solution.noise,
        quanta=quanta,
        shift=solution.shift,
        robust=robust,
    )
    return chosen if refined is None else replace(chosen, local=replace(local, solution=refined, records=segments))


def with_known_delay(form: Form, delay: float | None) -> Form:
    """Return *form* with its delay fixed at *delay* [s], or unchanged if *delay* is None.

    A zero delay is added only if the form has a delay parameter.
    """
    if delay is None or (delay == 0.0 and "delay" not in form.parameters):
        return form
    return form.fixing({"delay": delay})


def outcome(
    case: Case, chosen: Delayed, limits: Limits, method: str, extra: Mapping[str, Any] | None = None
) -> Fit[CoupledModel]:
    """Return the :class:`Fit` of *chosen* with its doubts.

    extra : entries to add to ``Fit.extra``.
    """
    solution, records = chosen.local.solution, chosen.local.records
    form = solution.form
    table = form_table(
        form,
        solution.theta,
        case.input_units,
        solution.names,
        solution.raised_covariance,
        bounds=solution.bounds,
        status=dict.fromkeys(solution.at_bound, "at_bound"),
    )
    return fit_of(
        case,
        method,
        solution.base,
        table,
        Motion.of_solution(records, solution),
        structure=form.name,
        doubts=_doubts(chosen, limits),
        extra={
            "signals": list(solution.noise),
            **solution_extra(solution, delay_evidence=chosen.evidence),
            **(extra or {}),
        },
    )


def _doubts(chosen: Delayed, limits: Limits) -> list[Doubt]:
    """Return the doubts about the chosen fit."""
    solution, records = chosen.local.solution, chosen.local.records
    std = np.sqrt(np.maximum(np.diag(solution.raised_covariance), 0.0)).tolist()
    values = dict(zip(solution.form.parameters, solution.theta.tolist(), strict=True))
    return doubts_about(
        solution,
        chosen.local,
        Gains(solution.form, values, dict(zip(solution.names, std, strict=True))),
        FittedDelay(solution, chosen.evidence),
        outlier_run(solution, records, limits),
    )


def fit_axis_by_output_error(case: Case) -> AxisFit:
    """Return the output-error fit of one degree of freedom.

    Roll and pitch have a restoring moment, which the exact simulation of the other degrees of freedom does not contain.
    They are fitted as forms.
    """
    if case.records[0].dof.restored:
        return for_axis(fit_coupled_by_output_error, fits_delay=True)(case)
    return fit_by_output_error(case)


METHOD = Method(
    "output-error",
    "maximum likelihood fit of the simulated to the measured motion",
    axis=fit_axis_by_output_error,
    coupled=fit_coupled_by_output_error,
    options=OPTIONS,
    bears=frozenset({"stamps", "rounding", "robust", "delay", "effects", "lever arm"}),
)
