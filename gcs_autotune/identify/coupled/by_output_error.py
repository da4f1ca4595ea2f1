"""The method ``output-error`` for coupled models: start, delay, fit, what to doubt."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.errors import NotInformative
from gcs_autotune.identify.axis.residuals import rounding_error
from gcs_autotune.identify.coupled.case import CoupledCase
from gcs_autotune.identify.coupled.limits import limits_of
from gcs_autotune.identify.coupled.objective import Limits
from gcs_autotune.identify.coupled.output_error import CoupledSolution, solve_coupled
from gcs_autotune.identify.coupled.record import CoupledRecord
from gcs_autotune.identify.coupled.smoothing import first_levels_of
from gcs_autotune.identify.coupled.start import first_states, motions_of, regression_start
from gcs_autotune.identify.result import Doubt, Fit, Parameter, Status, Trace
from gcs_autotune.models.coupled import CoupledModel, Form, unit_of
from gcs_autotune.sname import SIGNALS

__all__ = ["fit_coupled_by_output_error", "fit_of"]

Array = NDArray[np.float64]


def fit_coupled_by_output_error(case: CoupledCase) -> Fit:
    """Fit *case* by output error.

    Raises
    ------
    NotInformative
        No model of this form can be simulated on these runs.
    """
    form = _with_delay(case.form, case.delay)
    limits = limits_of(form, case)
    solution = local_fit(form, case.records, limits, robust=case.robust)
    return fit_of(case, solution, "output-error", ())


def _with_delay(form: Form, delay: float | None) -> Form:
    if delay is None or (delay == 0.0 and "delay" not in form.parameters):
        return form
    return form.fixing({"delay": delay})


def local_fit(form: Form, records: Sequence[CoupledRecord], limits: Limits, *, robust: bool) -> CoupledSolution:
    """Fit *form* from the regression's start."""
    motions = motions_of(form, records, form.known.get("delay", 0.0))
    theta = regression_start(form, motions, limits)
    initial = first_states(form, records, motions)
    found = solve_coupled(form, records, theta, initial, limits, levels=first_levels_of(records), robust=robust)
    if found is None:
        raise NotInformative(f"no model '{form.name}' could be simulated on run '{records[0].run}'")
    return found


def fit_of(case: CoupledCase, solution: CoupledSolution, method: str, doubts: Sequence[Doubt]) -> Fit:
    """Return what was found, in the words of :class:`Fit`."""
    form, names = solution.form, solution.form.parameters
    units = dict(zip(form.inputs, case.records[0].input_units, strict=True))
    model = CoupledModel(form, dict(zip(names, solution.theta.tolist(), strict=True)))
    covariance, bounds, k = np.zeros((len(names),) * 2), {}, len(solution.free)
    places = [names.index(n) for n in solution.free]
    covariance[np.ix_(places, places)] = solution.covariance
    for i, name in enumerate(solution.free):
        bounds[name] = float(np.sqrt(solution.whole[i, i]))
    parameters = {}
    for place, name in enumerate(names):
        status: Status = "fixed" if name not in solution.free else "at_bound" if name in solution.at_bound else "fitted"
        std = float(np.sqrt(covariance[place, place]))
        parameters[name] = Parameter(
            name,
            float(solution.theta[place]),
            unit_of(name, units, normalised=form.normalised),
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
        fit_percent=_fit_percent(solution),
        used=case.names,
        noise=solution.noise,
        doubts=tuple(doubts),
        traces=_traces(case.records, solution),
        extra={"rounding": {n: rounding_error(solution.residuals, n) for n in solution.noise}, "fitted": k},
    )


def _fit_percent(solution: CoupledSolution) -> float:
    shares = []
    for name in solution.laws:
        own = [r for r in solution.residuals if r.signal.name == name]
        power = sum(float(np.var(r.signal.values)) * len(r.error) for r in own)
        left = sum(float(r.error @ r.error) for r in own)
        if power > 0.0:
            shares.append(100.0 * (1.0 - np.sqrt(left / power)))
    return float(np.mean(shares)) if shares else 0.0


def _traces(records: Sequence[CoupledRecord], solution: CoupledSolution) -> tuple[Trace, ...]:
    traces = []
    factor = float(solution.factors.max(initial=1.0))
    for r, rows in zip(solution.residuals, solution.rows, strict=True):
        name = r.signal.name
        spread = np.einsum("ij,jk,ik->i", rows, solution.whole, rows, optimize=True) * factor**2
        band = 1.96 * solution.noise[name] * np.sqrt(1.0 + np.maximum(spread, 0.0))
        fitted = r.signal.values - r.error
        traces.append(Trace(records[r.record].run, r.signal.t, r.signal.values, fitted, band, name, SIGNALS[name][0]))
    return tuple(traces)
