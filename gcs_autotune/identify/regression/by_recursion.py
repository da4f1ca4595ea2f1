"""The method ``recursive-least-squares``: the estimate as it develops along the run, with optional forgetting.

Each row of the equations changes the estimate by ``P J' (R + J P J')^-1`` times the acceleration error of the row. The
source is Ljung1999, ch. 11, here with Jacobians calculated at the current estimate. With ``equation=integral`` a row is
complete half a window after its time. With ``derivative`` the smoothed acceleration uses the whole run, so only the
estimate is recursive.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.errors import NotInformative, UsageError
from gcs_autotune.identify.case import Case
from gcs_autotune.identify.coupled.one_axis import for_axis
from gcs_autotune.identify.doubt import Doubt
from gcs_autotune.identify.fit_builder import model_of
from gcs_autotune.identify.method import Method
from gcs_autotune.identify.problems.least_squares import inverse_of
from gcs_autotune.identify.regression.by_least_squares import refusing_runaways
from gcs_autotune.identify.regression.collinearity import collinearity_doubts
from gcs_autotune.identify.regression.noise_bias import noise_bias, noise_bias_doubt, with_bias
from gcs_autotune.identify.regression.outcome import regression_fit
from gcs_autotune.identify.regression.physical import check_physics, physics_doubts, velocities_visited
from gcs_autotune.identify.regression.recipe import OPTIONS as RECIPE_OPTIONS
from gcs_autotune.identify.regression.recipe import recipe_of
from gcs_autotune.identify.regression.rows import Rows
from gcs_autotune.identify.regression.solver import Equations, Estimate, row_starts, solve
from gcs_autotune.identify.regression.spread import excess_doubt
from gcs_autotune.identify.result import Fit
from gcs_autotune.identify.settled_stamps import on_settled_stamps
from gcs_autotune.models import CoupledModel

__all__ = ["METHOD", "OPTIONS", "History", "fit_axis_by_recursion", "fit_by_recursion", "recursive"]

Array = NDArray[np.float64]

OPTIONS = (*RECIPE_OPTIONS, ("forgetting", "time constant of the forgetting factor [s] (default: no forgetting)"))
"""Options of ``fit`` that this method reads, with a line of help each."""

LEARNT = 4
"""Number of rows per parameter from which the first estimate is made.

Rows of all degrees of freedom count. Project choice.
"""

KEPT = 500
"""Maximum number of points of the history stored in ``extra``. Project choice."""

DRIFT = 3.0
"""Standard errors by which the last third of the history must differ from the second third for a parameter to count
as drifting. Project choice.
"""


@dataclass(frozen=True, slots=True, eq=False)
class History:
    """Values of the parameters along the runs.

    - ``t`` (s,) [s]: running time, summed over the runs.
    - ``values``, ``stds`` (s, f): values and standard errors of the parameters after each row.
    """

    t: Array
    values: Array
    stds: Array


@on_settled_stamps
def fit_by_recursion(case: Case) -> Fit[CoupledModel]:
    """Return the fit of *case* by recursive least squares.

    Exceptions are those of :func:`.fit_by_least_squares`. ``extra["history"]`` contains ``t`` [s], and the ``values``
    and ``stds`` of each parameter along the runs.
    """
    forgetting = case.options.get("forgetting")
    if forgetting is not None and not float(forgetting) > 0.0:
        raise UsageError(f"a forgetting time constant of {forgetting} s is not valid. Use more than 0 s")
    recipe, motions, batch, _ = recipe_of(case, robust=case.robust)
    rows = recipe.rows(case.records, motions)
    estimate, history = recursive(batch, rows, math.inf if forgetting is None else float(forgetting))
    names = recipe.form.free
    bias = noise_bias(batch, recipe, case.records, motions, robust=case.robust)
    doubts = collinearity_doubts(estimate) + _drift(history, names)
    missed = excess_doubt(batch)
    doubts += [] if missed is None else [missed]
    noisy = noise_bias_doubt(estimate, bias)
    doubts += [] if noisy is None else [noisy]
    checks = check_physics(model_of(recipe.form, estimate.theta), velocities_visited(motions))
    doubts += physics_doubts(checks)
    some = np.unique(np.linspace(0, len(history.t) - 1, KEPT).astype(int))
    samples = {
        "t": history.t[some].tolist(),
        "values": {n: history.values[some, i].tolist() for i, n in enumerate(names)},
        "stds": {n: history.stds[some, i].tolist() for i, n in enumerate(names)},
    }
    extra: dict[str, Any] = {
        "equation": recipe.equation,
        "derivative": recipe.derivative,
        "window": recipe.window,
        "history": samples,
        "noise_bias": dict(zip(names, bias.tolist(), strict=True)),
        "batch": dict(zip(names, batch.free.tolist(), strict=True)),
        "physics": [check.description for check in checks],
    }
    return regression_fit(case, with_bias(estimate, bias), motions, "recursive-least-squares", doubts, extra)


def recursive(batch: Estimate, rows: Sequence[Rows], forgetting: float) -> tuple[Estimate, History]:
    """Return the final estimate and its history, after recursion over the rows of all runs.

    Parameters
    ----------
    batch : estimate that supplies the noise of a row, and the factor for coloured residuals. Its parameters are not
        used.
    forgetting : time constant [s], infinite for none.
    """
    equations, f = batch.equations, len(batch.equations.free)
    t = _running_time(rows)
    k = equations.E.shape[1]
    first = min(max(math.ceil(LEARNT * f / k), 2 * f), len(equations.E) // 2)
    theta, P = _first(equations, first, batch)
    R = np.diag(1.0 / batch.weights.mean(axis=0)) * _colour(batch)
    values, stds, at = [theta[:f].copy()], [np.sqrt(np.diag(P))], [t[first - 1]]
    for i in range(first, len(equations.E)):
        linearised = replace(equations, E=equations.E[i : i + 1]).errors(theta)
        kept = math.exp(-max(t[i] - t[i - 1], 0.0) / forgetting)
        P = P / kept
        if linearised is not None:
            e, J = linearised[0][0], linearised[1][0]
            K = np.linalg.solve(R + J @ P @ J.T, J @ P).T
            theta = theta.copy()
            theta[:f] -= K @ e
            P = P - K @ J @ P
            P = 0.5 * (P + P.T)
        values.append(theta[:f].copy())
        stds.append(np.sqrt(np.maximum(np.diag(P), 0.0)))
        at.append(t[i])
    linearised = equations.errors(theta)
    if linearised is None:
        raise NotInformative(
            f"the recursion of '{equations.form.name}' ended in a singular inertia matrix. Use least-squares"
        )
    estimate = Estimate(equations, theta, linearised[0], linearised[1], batch.weights, P, converged=True)
    return estimate, History(np.array(at), np.array(values), np.array(stds))


def _running_time(rows: Sequence[Rows]) -> Array:
    parts, passed = [], 0.0
    for own in rows:
        parts.append(own.t - own.t[0] + passed)
        passed = float(parts[-1][-1]) + float(np.median(np.diff(own.t)))
    return np.concatenate(parts)


def _first(equations: Equations, count: int, batch: Estimate) -> tuple[Array, Array]:
    """Return the estimate from the first *count* rows, and its covariance (f, f)."""
    part = replace(equations, E=equations.E[:count], ends=(count,))
    estimate = solve(part, row_starts(part))
    weights = np.broadcast_to(batch.weights.mean(axis=0), estimate.errors.shape)
    return estimate.theta, inverse_of(replace(estimate, weights=weights).information) * _colour(batch)


def _colour(batch: Estimate) -> float:
    """Return the factor by which coloured residuals raise the variances."""
    white = np.diag(inverse_of(batch.information))
    return float(np.clip(np.median(np.diag(batch.covariance) / np.maximum(white, 1e-300)), 1.0, 100.0))


def _drift(history: History, names: Sequence[str]) -> list[Doubt]:
    third = len(history.t) // 3
    if third < 3:
        return []
    before, after = history.values[2 * third], history.values[-1]
    spread = np.sqrt(np.maximum(np.abs(history.stds[2 * third] ** 2 - history.stds[-1] ** 2), history.stds[-1] ** 2))
    moved = [n for n, a, b, s in zip(names, before, after, spread, strict=True) if abs(b - a) > DRIFT * s]
    if not moved:
        return []
    return [
        Doubt(
            "drifting",
            f"{', '.join(moved)} still changed by more than {DRIFT:.0f} standard errors in the last third of the runs",
            "check for a change of craft or conditions, or a missing term. Inspect the history and identify the "
            "parts separately",
        )
    ]


fit_axis_by_recursion = for_axis(lambda case: refusing_runaways(fit_by_recursion(case)))
"""Function that fits one degree of freedom by recursive least squares.

It rejects models that diverge on their own runs.
"""


METHOD = Method(
    "recursive-least-squares",
    "recursive least squares along the run, with optional forgetting",
    axis=fit_axis_by_recursion,
    coupled=fit_by_recursion,
    options=OPTIONS,
    bears=frozenset({"stamps"}),
)
