"""Fit by extended and sigma-point Kalman filters whose state contains the parameters (ZhaoUSV, (8)-(18)).

The filter runs over the records. Then the noise levels are fitted to its innovations. The filter is repeated from its
own result until the parameters settle. A repeated pass starts with a prior three standard errors wide around the last
result. The information of that prior is subtracted again, so that the data count once.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.errors import NotInformative, UsageError
from gcs_autotune.identify.case import Case
from gcs_autotune.identify.coupled.one_axis import for_axis
from gcs_autotune.identify.kalman.filter_bank import FilterResult, Levels, Prior, Smoothed
from gcs_autotune.identify.kalman.report import FilterEstimate, report, thinned
from gcs_autotune.identify.kalman.smoother import SETTLED, iterate, positive_inertia, settled
from gcs_autotune.identify.kalman.task import OPTIONS, REPEAT, Task, first_states, task_of
from gcs_autotune.identify.method import Method
from gcs_autotune.identify.result import Fit
from gcs_autotune.identify.settled_stamps import on_settled_stamps
from gcs_autotune.models import CoupledModel

__all__ = ["EKF", "FILTER_OPTIONS", "UKF", "fit_by_ekf", "fit_by_ukf"]

Array = NDArray[np.float64]

FILTER_OPTIONS = (
    *OPTIONS,
    ("parameter_walk", "drift of a parameter in 1 s, as a fraction of its natural scale (0: constant parameters)"),
    ("passes", "maximum number of passes over the runs (40). 1 is the recursive filter"),
)

PASSES = 40
"""Default maximum number of passes over the runs. 10 to 25 suffice, because the noise levels converge geometrically.

Project choice.
"""

CLOSE = 0.5
"""Largest move of every parameter in a pass, in standard errors, from which the next passes use smoothed first states.

The spread of the smoothed states is then the prior standard deviation. Project choice.
"""


HOPELESS = 3
"""Number of passes after which the fit stops if the inertia is still not positive definite. Project choice."""


def fit_by_ekf(case: Case) -> Fit[CoupledModel]:
    """Return a coupled model fitted to *case* by the extended Kalman filter.

    The free parameters of the form are part of the state of the filter.
    """
    return _fit(case, "ekf", sigma=False)


@on_settled_stamps
def fit_by_ukf(case: Case) -> Fit[CoupledModel]:
    """Return a coupled model fitted to *case* by the sigma-point filter; see :func:`.transition.sigma_step`.

    This filter cannot estimate a shift of stamps.
    """
    return _fit(case, "ukf", sigma=True)


def _fit(case: Case, method: str, *, sigma: bool) -> Fit[CoupledModel]:
    task = task_of(case)
    passes = int(case.options.get("passes", PASSES))
    walk = float(case.options.get("parameter_walk", 0.0))
    if passes < 1 or walk < 0.0:
        raise UsageError(f"passes must be 1 or more, not {passes}. parameter_walk must not be negative, not {walk}")
    drift = (walk * task.start.scale) ** 2
    ended = _passes(task, task.prior, replace(task.start.levels, walk=drift), passes, sigma=sigma)
    rescued = passes > 1 and (ended is None or not positive_inertia(task, ended.result.parameters))
    if rescued:
        smooth = iterate(task, passes)
        first = task.prior
        states, spread = first_states(smooth.smoothed, first.spread)
        near = Prior(states, spread, smooth.result.parameters, REPEAT**2 * smooth.result.covariance)
        ended = _passes(task, near, replace(smooth.levels, walk=drift), passes, sigma=sigma) or ended
    if ended is None:
        raise NotInformative(
            f"the filter diverged on run '{case.names[0]}' from these start values. Supply other start values "
            "(start=...), or a larger state_noise"
        )
    std = np.sqrt(np.diag(ended.covariance))
    estimate = FilterEstimate(
        ended.result.parameters,
        ended.covariance,
        std if walk == 0.0 else np.full(len(std), np.nan),
        ended.levels,
        ended.result,
        ended.moved,
        extra={"passes": ended.count, "rescued": rescued, "history": _history(task, ended.result)},
    )
    return report(task, method, estimate)


@dataclass(frozen=True, slots=True, eq=False)
class _Ended:
    """State of the filter after its last pass.

    - ``result``: the pass.
    - ``covariance`` (p, p): covariance of the parameters from the data alone, without the prior.
    - ``levels``: noise levels.
    - ``moved``: last move of each parameter in standard errors.
    - ``count``: number of passes.
    """

    result: FilterResult
    covariance: Array
    levels: Levels
    moved: Array
    count: int


def _passes(task: Task, prior: Prior, levels: Levels, passes: int, *, sigma: bool) -> _Ended | None:
    """Return the result of at most *passes* passes from *prior*, or None if the first pass diverges."""
    ended, close = None, False
    for count in range(1, passes + 1):
        now = _survived(task, prior, levels, sigma=sigma)
        if now is None:
            break
        result, levels = now
        smoothed = task.bank.smooth(result, levels)
        after = task.tuned(levels, smoothed)
        covariance = result.covariance if count == 1 else _alone(result.covariance, prior.covariance)
        moved = np.abs(result.parameters - prior.parameters) / np.sqrt(np.diag(covariance))
        moved = moved if count > 1 else np.zeros_like(moved)
        ended = _Ended(result, covariance, levels, moved, count)
        if count > 1 and bool(np.all(moved < SETTLED)) and settled(levels, after, smoothed):
            break
        if count >= HOPELESS and not positive_inertia(task, result.parameters):
            break
        levels = after
        close = close or bool(count > 1 and np.all(moved < CLOSE))
        prior = _next(task, result, covariance, smoothed, close=close)
    return ended


def _survived(task: Task, prior: Prior, levels: Levels, *, sigma: bool) -> tuple[FilterResult, Levels] | None:
    """Run one pass and return it with its noise levels, or None if all attempts diverge.

    After divergence the pass is repeated with more process noise, which ties the states to the samples.
    """
    for _ in range(6):
        result = task.bank.run(task.theta(prior.parameters), prior, levels, sigma=sigma, full=True)
        if result is not None:
            return result, levels
        levels = replace(levels, drive=np.maximum(task.loose, 10.0 * levels.drive))
    return None


def _next(task: Task, result: FilterResult, covariance: Array, smoothed: Smoothed, *, close: bool) -> Prior:
    """Return the prior of the next pass.

    It starts at the result of this pass, with a wide spread that never exceeds the first one.

    close : whether the parameters have nearly settled, so that the spread of the smoothed first states is reliable.
    """
    first = task.prior
    wide = np.minimum(REPEAT, np.sqrt(np.diag(first.covariance) / np.diag(covariance)))
    states, spread = first_states(smoothed, first.spread)
    return Prior(states, spread if close else first.spread, result.parameters, covariance * np.outer(wide, wide))


def _alone(after: Array, before: Array) -> Array:
    """Return the covariance of the parameters from the data alone.

    It is the covariance *after* a pass without the information in that *before* it.
    """
    unit = np.sqrt(np.diag(before))
    w, V = np.linalg.eigh(after / np.outer(unit, unit))
    root = V * np.sqrt(np.maximum(w, 1e-300))
    share, W = np.linalg.eigh(root.T @ np.linalg.inv(before / np.outer(unit, unit)) @ root)
    side = root @ W
    alone: Array = (side / np.maximum(1.0 - share, 1e-3)) @ side.T * np.outer(unit, unit)
    return alone


def _history(task: Task, result: FilterResult) -> dict[str, Any]:
    """Return stamps, value and standard deviation of every parameter during the last pass, thinned, run by run."""
    n = len(task.bank.states)
    runs = []
    for track, history in zip(task.bank.tracks, result.histories, strict=True):
        at = thinned(np.arange(len(track.stamps)))
        std = np.sqrt(np.diagonal(history.covariance[at], axis1=1, axis2=2))
        runs.append(
            {
                "run": track.record.name,
                "t": track.stamps[at].tolist(),
                "value": {f: history.mean[at, n + i].tolist() for i, f in enumerate(task.bank.free)},
                "std": {f: std[:, n + i].tolist() for i, f in enumerate(task.bank.free)},
            }
        )
    return {"runs": runs}


EKF = Method(
    "ekf",
    "extended Kalman filter with the parameters in its state",
    axis=for_axis(fit_by_ekf),
    coupled=fit_by_ekf,
    options=FILTER_OPTIONS,
    bears=frozenset({"stamps"}),
)

UKF = Method(
    "ukf",
    "sigma-point Kalman filter with the parameters in its state",
    axis=for_axis(fit_by_ukf),
    coupled=fit_by_ukf,
    options=FILTER_OPTIONS,
    bears=frozenset({"stamps"}),
)
