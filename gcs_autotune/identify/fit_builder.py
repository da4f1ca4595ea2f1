"""Build a :class:`Fit` from the result of a method.

Every ``Fit`` of runs is made here. A method provides a table of its parameters (:func:`table_of`, :func:`axis_table`),
the motion of its model (:meth:`Motion.freely`, :meth:`Motion.of_solution`) and its doubts. :func:`fit_of` combines
them.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.effects import ExtendedModel
from gcs_autotune.identify.case import Case
from gcs_autotune.identify.doubt import Doubt, once
from gcs_autotune.identify.free_run import fit_percent_of, rms_of, runs_or_doubt
from gcs_autotune.identify.problems.reweighting import rounding_error
from gcs_autotune.identify.problems.solution import Solution, fit_percents, traces_of
from gcs_autotune.identify.result import Decision, Fit, IsoEstimate, Parameter, Status, StructureFit, Trace
from gcs_autotune.identify.signals.segment import Segment
from gcs_autotune.models import CoupledModel, Form, SingleDof

__all__ = [
    "AxisDetails",
    "Motion",
    "Table",
    "axis_table",
    "fit_of",
    "form_table",
    "model_of",
    "solution_extra",
    "table_of",
]

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Table:
    """All parameters of a model, fitted or not, and their covariance (p, p) in the same order."""

    parameters: Mapping[str, Parameter]
    covariance: Array


def table_of(
    values: Mapping[str, float],
    units: Mapping[str, str],
    fitted: Sequence[str],
    covariance: Array,
    *,
    bounds: Mapping[str, float] | None = None,
    status: Mapping[str, Status] | None = None,
    unknown: Sequence[str] = (),
) -> Table:
    """Return the table of all *values*.

    fitted : (f,) names of the parameters to which *covariance* (f, f) belongs.
    bounds : name -> Cramer-Rao bound. NaN for missing names.
    status : name -> status, if it is not "fitted" for a fitted parameter or "fixed" for another one.
    unknown : names of parameters that were fitted without a standard error, which is then NaN.
    """
    names = list(values)
    whole = np.zeros((len(names),) * 2)
    places = [names.index(n) for n in fitted]
    whole[np.ix_(places, places)] = covariance
    stds = np.sqrt(np.maximum(np.diag(whole), 0.0)).tolist()
    given, least = status or {}, bounds or {}
    parameters = {}
    for name, std in zip(names, stds, strict=True):
        usual: Status = "fitted" if name in fitted or name in unknown else "fixed"
        error = math.nan if name in unknown else std
        bound = float(least.get(name, math.nan))
        parameters[name] = Parameter(name, float(values[name]), units[name], error, given.get(name, usual), bound)
    return Table(parameters, whole)


def form_table(
    form: Form,
    theta: Array,
    units: Mapping[str, str],
    fitted: Sequence[str],
    covariance: Array,
    **more: Any,
) -> Table:
    """Return the table of a form's parameters *theta* (p,).

    units : units of the form's inputs. Other arguments are those of :func:`table_of`.
    """
    values = dict(zip(form.parameters, theta.tolist(), strict=True))
    return table_of(values, {n: form.unit_of(n, units) for n in values}, fitted, covariance, **more)


def axis_table(model: SingleDof, covariance: Array, status: Sequence[Status], bounds: Sequence[float] = ()) -> Table:
    """Return the table of one degree of freedom.

    covariance : (5, 5), in the order (alpha, beta, beta_quadratic, delta, delay). In roll and pitch (6, 6): the
        restoring moment follows.
    status, bounds : one entry per parameter, in the same order.
    """
    names: tuple[str, ...] = (*model.axis.parameter_names(), "delay")
    units: tuple[str, ...] = (*model.axis.parameter_units(model.input_unit), "s")
    values: tuple[float, ...] = (model.alpha, model.beta, model.beta_quadratic, model.delta, model.delay)
    if model.axis.restored:
        names, values = (*names, model.axis.restoring_name), (*values, model.restoring)
        units = (*units, model.axis.restoring_unit(model.input_unit))
    return table_of(
        dict(zip(names, values, strict=True)),
        dict(zip(names, units, strict=True)),
        names,
        covariance,
        bounds=dict(zip(names, bounds, strict=True)) if bounds else None,
        status=dict(zip(names, status, strict=True)),
    )


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """Motion of a model on the runs it was fitted to, compared with the measured motion.

    - ``traces``: measured and fitted motion, one trace per run and signal.
    - ``fit_percent``: 100 (1 - rms/std), averaged over signals.
    - ``rms``: root mean square of the residual of the main signal, or of all signals.
    - ``noise``: name of the signal -> standard deviation of its noise.
    - ``doubts``: a doubt if the motion diverges.
    """

    traces: tuple[Trace, ...]
    fit_percent: float
    rms: float
    noise: Mapping[str, float] = field(default_factory=dict)
    doubts: tuple[Doubt, ...] = ()

    @classmethod
    def freely(
        cls, model: SingleDof | CoupledModel, segments: Sequence[Segment], noise: Mapping[str, float] | None = None
    ) -> Motion:
        """Return the free run of *model* on all *segments*.

        If the model diverges, the result has a doubt instead of traces.
        """
        traces, runaway = runs_or_doubt(model, segments)
        return cls(traces, fit_percent_of(traces), rms_of(traces), noise or {}, runaway)

    @classmethod
    def of_solution(cls, segments: Sequence[Segment], solution: Solution, main: str | None = None) -> Motion:
        """Return the motion of *solution* on *segments*, restricted to the signal *main* if one is supplied."""
        percents, traces = fit_percents(solution), traces_of(segments, solution)
        if main is None:
            shares = list(percents.values())
            return cls(traces, float(np.mean(shares)) if shares else 0.0, math.nan, solution.noise)
        own = tuple(t for t in traces if t.signal == main)
        return cls(own, percents.get(main, 0.0), solution.rms(main), dict(solution.noise))


def solution_extra(solution: Solution, **more: float) -> dict[str, Any]:
    """Return the entries of ``Fit.extra`` for the solution of a form.

    more : further entries, by name.
    """
    return {
        "rounding": {n: rounding_error(solution.rests, n) for n in solution.noise},
        "std_inflation": float(solution.factors.max(initial=1.0)),
        "residual_correlation_time": solution.correlation,
        "log_likelihood": solution.log_likelihood,
        **more,
        "time_shift": solution.shift,
        "quantum": dict(solution.quanta),
    }


@dataclass(frozen=True, slots=True, eq=False)
class AxisDetails:
    """Further results for one degree of freedom.

    - ``main``: name of the main signal.
    - ``iso``: readings of limit cycles.
    - ``decision``, ``candidates``: the comparison by which the drag structure was chosen.
    """

    main: str
    iso: tuple[IsoEstimate, ...] = ()
    decision: Decision | None = None
    candidates: tuple[StructureFit, ...] = ()


ModelT = TypeVar("ModelT", SingleDof, CoupledModel, ExtendedModel, CoupledModel | ExtendedModel)


def fit_of(
    case: Case,
    method: str,
    model: ModelT,
    table: Table,
    motion: Motion,
    *,
    structure: str,
    doubts: Iterable[Doubt],
    extra: Mapping[str, Any],
    axis: AxisDetails | None = None,
) -> Fit[ModelT]:
    """Return the fit of *case* by *method*.

    doubts : doubts of the method. Doubts about the runs are listed before them.
    """
    noise_std = math.nan if axis is None else motion.noise.get(axis.main, motion.rms)
    return Fit(
        dof=dof_of(model),
        structure=structure,
        method=method,
        model=model,
        parameters=table.parameters,
        covariance=table.covariance,
        fit_percent=motion.fit_percent,
        used=case.names,
        noise=motion.noise,
        doubts=once([*case.all_notes, *doubts]),
        traces=motion.traces,
        extra=dict(extra),
        noise_std=noise_std,
        residual_rms=math.nan if axis is None else motion.rms,
        iso=() if axis is None else axis.iso,
        decision=None if axis is None else axis.decision,
        candidates=() if axis is None else axis.candidates,
    )


def dof_of(model: SingleDof | CoupledModel | ExtendedModel) -> str:
    """Return the names of the degrees of freedom of a model, joined as in ``surge+yaw``."""
    if isinstance(model, SingleDof):
        return model.dof
    base = model.base if isinstance(model, ExtendedModel) else model
    return "+".join(base.form.dofs)


def model_of(form: Form, theta: Array) -> CoupledModel:
    """Return the model of *form* with the parameters *theta* (p,)."""
    return CoupledModel(form, dict(zip(form.parameters, theta.tolist(), strict=True)))
