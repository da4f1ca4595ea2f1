"""Build a ``Fit`` from the result of a filter, with parameters, free-run traces, innovations and doubts.

Doubts are about coloured innovations, parameters that have not settled, and parameters that the run does not excite.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gcs_autotune import chi_square
from gcs_autotune.identify.doubt import Doubt
from gcs_autotune.identify.doubts import COLOUR
from gcs_autotune.identify.fit_builder import Motion, fit_of, table_of
from gcs_autotune.identify.kalman.filter_bank import FilterResult, Levels
from gcs_autotune.identify.kalman.task import Task
from gcs_autotune.identify.result import Fit
from gcs_autotune.models import CoupledModel

__all__ = ["MOST_POINTS", "FilterEstimate", "filter_doubts", "report"]

Array = NDArray[np.float64]

MOST_POINTS = 200
"""Maximum number of points of a parameter's history that are stored for plots. Project choice."""


@dataclass(frozen=True, slots=True, eq=False)
class FilterEstimate:
    """Result of a filter method, from which a ``Fit`` is built.

    - ``parameters`` (p,), ``covariance`` (p, p), ``bounds`` (p,): free parameters, their covariance and Cramer-Rao
      bounds.
    - ``levels``: noise levels.
    - ``last``: the last pass.
    - ``moved`` (p,): change of each parameter in the last pass, in standard errors.
    - ``doubts``: doubts that the method raises itself.
    - ``extra``: further entries for ``Fit.extra``.
    """

    parameters: Array
    covariance: Array
    bounds: Array
    levels: Levels
    last: FilterResult
    moved: Array
    doubts: tuple[Doubt, ...] = ()
    extra: Mapping[str, Any] = field(default_factory=dict)


def report(task: Task, method: str, estimate: FilterEstimate) -> Fit[CoupledModel]:
    """Return the ``Fit`` of *method*, built from its result *estimate*."""
    form, bank, case = task.bank.form, task.bank, task.case
    std = np.sqrt(np.maximum(np.diag(estimate.covariance), 0.0))
    sought = [n for n in bank.free if not task.is_shift(n)]
    at = [bank.free.index(n) for n in sought]
    values = {n: float(estimate.parameters[bank.free.index(n)]) for n in sought}
    values |= {n: float(task.stamps or 0.0) for n in task.form.parameters if task.is_shift(n)}
    values = {
        n: values[n] if n in values else float(form.known[n]) for n in form.parameters if n in task.form.parameters
    }
    table = table_of(
        values,
        {n: form.unit_of(n, case.input_units) for n in values},
        sought,
        estimate.covariance[np.ix_(at, at)],
        bounds=dict(zip(sought, estimate.bounds[at].tolist(), strict=True)),
    )
    model = CoupledModel(task.form, values)
    shift = {n: float(v) for n, v in zip(bank.free, estimate.parameters, strict=True) if task.is_shift(n)}
    noise = {s: float(np.sqrt(v)) for s, v in zip(bank.signals, estimate.levels.noise, strict=True)}
    motion = Motion.freely(CoupledModel(form, {**values, **shift}), case.records, noise)
    return fit_of(
        case,
        method,
        model,
        table,
        motion,
        structure=form.name,
        doubts=(*estimate.doubts, *motion.doubts, *filter_doubts(task, estimate.last, estimate.moved, std, model)),
        extra={
            "state_noise": {
                s: float(np.sqrt(v)) for s, v in zip(bank.states, estimate.levels.drive, strict=True) if s in "uvwpqr"
            },
            "log_likelihood": estimate.last.log_likelihood,
            "time_shift": sum(shift.values()) - (task.stamps or 0.0),
            "innovations": _innovations(task, estimate.last),
            **estimate.extra,
        },
    )


def _innovations(task: Task, last: FilterResult) -> dict[str, Any]:
    """Return one-step prediction errors and their expected standard deviations, per run and signal."""
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
    """Return at most :data:`MOST_POINTS` of *indices* (k,), evenly spaced, including the first and the last."""
    whole = np.asarray(indices, dtype=np.int64)
    if len(whole) <= MOST_POINTS:
        return whole
    return whole[np.round(np.linspace(0, len(whole) - 1, MOST_POINTS)).astype(np.int64)]


MOVING = 0.5
"""Change of a parameter in the last pass, in standard errors, above which it counts as not settled. Project choice."""

UNSEEN = 0.5
"""Standard error, relative to the prior standard deviation, above which a run hardly contains information on a
parameter.

Project choice.
"""


def filter_doubts(task: Task, last: FilterResult, moved: Array, std: Array, model: CoupledModel) -> tuple[Doubt, ...]:
    """Return the doubts about a fit, from its last pass and the change of each parameter in that pass.

    moved : (p,) changes of the parameters in the last pass, in standard errors.
    std : (p,) standard errors of the parameters.
    """
    doubts = [*_consistency(task, last)]
    names = [n for n in task.bank.free if not task.is_shift(n)]
    own = [task.bank.free.index(n) for n in names]
    moved, std, widest = moved[own], std[own], (task.spread * task.start.scale)[own]
    restless = [n for n, m in zip(names, moved, strict=True) if m > MOVING]
    if restless:
        doubts.append(
            Doubt(
                "still-moving",
                f"{', '.join(restless)} still changed by more than {MOVING} standard errors in the last round",
                "allow more passes, or supply start values closer to the craft",
            )
        )
    unseen = [n for n, s, w in zip(names, std, widest, strict=True) if s > UNSEEN * w]
    if unseen:
        doubts.append(
            Doubt(
                "not-seen",
                f"these runs hardly determine {', '.join(unseen)}. The values shown are mostly the start values",
                "fly a manoeuvre that excites the motion on which they act, or omit them from the form",
            )
        )
    M = model.inertia
    if np.any(np.linalg.eigvalsh(0.5 * (M + M.T)) <= 0.0):
        doubts.append(
            Doubt(
                "inertia-not-positive",
                "the fitted inertia matrix is not positive definite, which is physically impossible",
                "fly steps of the inputs, so that accelerations determine the inertia. Check the signs of the inputs",
            )
        )
    return tuple(doubts)


def _consistency(task: Task, last: FilterResult) -> list[Doubt]:
    e, S = last.innovations
    doubts = []
    for j, name in enumerate(task.bank.signals):
        seen = ~np.isnan(S[:, j])
        z = (e[:, j] / np.sqrt(S[:, j]))[seen]
        n = len(z)
        nis, low, high = float(z @ z), chi_square.quantile(0.0005, n), chi_square.quantile(0.9995, n)
        if not 0.9 * low <= nis <= 1.1 * high:
            doubts.append(
                Doubt(
                    "filter-inconsistent",
                    f"{name}: innovations are {np.sqrt(nis / n):.2f} times as large as the filter expects (NIS test)",
                    "let the method estimate the noise levels. If it already did, add the missing term to the form",
                )
            )
        colour = float(z[1:] @ z[:-1] / max(nis, 1e-300))
        if abs(colour) > max(COLOUR, 4.0 / np.sqrt(n)):
            doubts.append(
                Doubt(
                    "innovations-coloured",
                    f"{name}: successive innovations are correlated ({colour:+.2f}), so they contain more than noise",
                    "add the missing term to the form. Check whether the sensor filters its signal",
                )
            )
    return doubts
