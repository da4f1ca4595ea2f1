"""From what a filter found to a ``Fit``: parameters, free-run traces, innovations and doubts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.identify.free_run import fit_percent_of, runs_or_doubt
from gcs_autotune.identify.kalman.doubts import filter_doubts
from gcs_autotune.identify.kalman.filter_bank import FilterResult, Levels
from gcs_autotune.identify.kalman.task import Task
from gcs_autotune.identify.result import Doubt, Fit, Parameter
from gcs_autotune.models import CoupledModel

__all__ = ["MOST_POINTS", "Found", "report"]

Array = NDArray[np.float64]

MOST_POINTS = 200
"""Points of a history kept for pictures."""


@dataclass(frozen=True, slots=True, eq=False)
class Found:
    """What a method found: free parameters (p,), covariance (p, p), their bounds (p,), levels, its last pass.

    ``moved`` (p,): how far the last round still moved each parameter, in its standard errors; ``extra`` for the fit.
    """

    parameters: Array
    covariance: Array
    bounds: Array
    levels: Levels
    last: FilterResult
    moved: Array
    doubts: tuple[Doubt, ...] = ()
    extra: Mapping[str, Any] = field(default_factory=dict)


def report(task: Task, method: str, found: Found) -> Fit:
    """Return the fit of *method*."""
    form, bank, case = task.bank.form, task.bank, task.case
    units = dict(zip(form.inputs, case.records[0].input_units, strict=True))
    std = np.sqrt(np.maximum(np.diag(found.covariance), 0.0))
    parameters: dict[str, Parameter] = {}
    names = [n for n in form.parameters if not task.is_shift(n) or n in task.form.parameters]
    for name in names:
        unit = form.unit_of(name, units)
        if task.is_shift(name):
            parameters[name] = Parameter(name, float(task.stamps or 0.0), unit, 0.0, "fixed")
        elif name in bank.free:
            i = bank.free.index(name)
            value, bound = float(found.parameters[i]), float(found.bounds[i])
            parameters[name] = Parameter(name, value, unit, float(std[i]), "fitted", bound)
        else:
            parameters[name] = Parameter(name, float(form.known[name]), unit, 0.0, "fixed")
    sought = [n for n in bank.free if not task.is_shift(n)]
    at, places = [bank.free.index(n) for n in sought], [names.index(n) for n in sought]
    covariance = np.zeros((len(names), len(names)))
    covariance[np.ix_(places, places)] = found.covariance[np.ix_(at, at)]
    values = {n: p.value for n, p in parameters.items()}
    model = CoupledModel(task.form, values)
    shift = {n: float(v) for n, v in zip(bank.free, found.parameters, strict=True) if task.is_shift(n)}
    traces, runaway = runs_or_doubt(CoupledModel(form, {**values, **shift}), case.records)
    own = tuple(d for r in case.records for d in r.notes)
    return Fit(
        dof="+".join(form.dofs) if len(form.dofs) > 1 else form.dofs[0],
        structure=form.name,
        method=method,
        model=model,
        parameters=parameters,
        covariance=covariance,
        fit_percent=fit_percent_of(traces),
        used=case.names,
        noise={s: float(np.sqrt(v)) for s, v in zip(bank.signals, found.levels.noise, strict=True)},
        doubts=(*own, *found.doubts, *runaway, *filter_doubts(task, found.last, found.moved, std, model)),
        traces=traces,
        extra={
            "state_noise": {
                s: float(np.sqrt(v)) for s, v in zip(bank.states, found.levels.drive, strict=True) if s in "uvwpqr"
            },
            "log_likelihood": found.last.log_likelihood,
            "time_shift": sum(shift.values()) - (task.stamps or 0.0),
            "innovations": _innovations(task, found.last),
            **found.extra,
        },
    )


def _innovations(task: Task, last: FilterResult) -> dict[str, Any]:
    """Return one-step prediction errors per run and signal, with the standard deviations the filter expects."""
    runs: dict[str, Any] = {}
    for track, history in zip(task.bank.tracks, last.histories, strict=True):
        own = {}
        for j, name in enumerate(task.bank.signals):
            seen = np.flatnonzero(~np.isnan(history.S[:, j]))
            at = thinned(seen)
            own[name] = {
                "t": track.stamps[at].tolist(),
                "error": history.e[at, j].tolist(),
                "std": np.sqrt(history.S[at, j]).tolist(),
            }
        runs[track.record.name] = own
    return runs


def thinned(indices: Sequence[int] | NDArray[np.int64]) -> NDArray[np.int64]:
    """Return at most MOST_POINTS of *indices*, first and last among them."""
    whole = np.asarray(indices, dtype=np.int64)
    if len(whole) <= MOST_POINTS:
        return whole
    return whole[np.round(np.linspace(0, len(whole) - 1, MOST_POINTS)).astype(np.int64)]
