"""Extended and sigma-point Kalman filters with the parameters in the state: seed 001, (8)-(18).

The filter runs over the records, the noise levels are fitted to what it leaves, and it runs again from its own answer,
until the parameters settle. A repeated pass starts three standard errors wide around the last answer, which is a fixed
point then; what that prior adds to the information is taken away again, so that the data count once.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.errors import NotInformative, UsageError
from gcs_autotune.identify.coupled.case import CoupledCase
from gcs_autotune.identify.kalman.bank import Levels, Passed, Prior, Smoothed
from gcs_autotune.identify.kalman.report import Found, report, thinned
from gcs_autotune.identify.kalman.task import OPTIONS, Task, task_of
from gcs_autotune.identify.result import Fit

__all__ = ["FILTER_OPTIONS", "fit_by_ekf", "fit_by_ukf", "settled"]

Array = NDArray[np.float64]

FILTER_OPTIONS = (
    *OPTIONS,
    ("parameter_walk", "how far a parameter may drift in 1 s, as a share of its natural scale (0: constants)"),
    ("passes", "most passes over the runs (40); 1 is the recursive filter"),
)

PASSES = 40
"""Most passes. Chosen: levels settle geometrically, 10 to 25 passes do."""

REPEAT = 3.0
"""Standard errors a repeated pass begins with: wide enough to move, narrow enough to stay where the model is linear."""

SETTLED = 0.02
"""Move in standard errors, and relative change of the levels that matter, at which passes end."""


def fit_by_ekf(case: CoupledCase) -> Fit:
    """Fit by the extended Kalman filter; *case* and result as every method for coupled models."""
    return _fit(case, "ekf", sigma=False)


def fit_by_ukf(case: CoupledCase) -> Fit:
    """Fit by the sigma-point filter; see :mod:`.sigma`."""
    return _fit(case, "ukf", sigma=True)


def _fit(case: CoupledCase, method: str, *, sigma: bool) -> Fit:
    task = task_of(case)
    passes = int(case.options.get("passes", PASSES))
    walk = float(case.options.get("parameter_walk", 0.0))
    if passes < 1 or walk < 0.0:
        raise UsageError(f"passes must be 1 or more and parameter_walk not negative, not {passes} and {walk}")
    levels = replace(task.start.levels, walk=(walk * task.start.scale) ** 2)
    prior, moved = task.prior, np.zeros(len(task.bank.free))
    last, count = None, 0
    for count in range(1, passes + 1):
        now = _survived(task, prior, levels, sigma=sigma)
        if now is None:
            break
        passed, levels = now
        smoothed = task.bank.smooth(passed, levels)
        after = task.tuned(levels, smoothed)
        covariance = passed.covariance if count == 1 else _alone(passed.covariance, prior.covariance)
        std = np.sqrt(np.diag(covariance))
        moved = np.abs(passed.parameters - prior.parameters) / std if count > 1 else moved
        last = (passed, levels, covariance)
        if count > 1 and bool(np.all(moved < SETTLED)) and settled(levels, after, smoothed):
            break
        levels = after
        if count < passes:
            prior = _next(task, passed, covariance, smoothed)
    if last is None:
        raise NotInformative(
            f"the filter ran away on run '{case.names[0]}' from these start values: give others (start=...), "
            "or a wider state_noise"
        )
    passed, levels, covariance = last
    bounds = np.sqrt(np.diag(covariance)) if walk == 0.0 else np.full(len(task.bank.free), np.nan)
    found = Found(
        passed.parameters,
        covariance,
        bounds,
        levels,
        passed,
        moved,
        extra={"passes": count, "history": _history(task, passed)},
    )
    return report(task, method, found)


def _survived(task: Task, prior: Prior, levels: Levels, *, sigma: bool) -> tuple[Passed, Levels] | None:
    """Run a pass; when the motion runs away, with ever more process noise, which ties the states to the samples."""
    for _ in range(6):
        passed = task.bank.run(task.theta(prior.parameters), prior, levels, sigma=sigma, full=True)
        if passed is not None:
            return passed, levels
        levels = replace(levels, drive=levels.drive * 10.0)
    return None


def _next(task: Task, passed: Passed, covariance: Array, smoothed: Smoothed) -> Prior:
    """Return the prior of the next pass: where this one ended, wide again, but not wider than at first."""
    n, first = len(task.bank.states), task.prior
    wide = np.minimum(REPEAT, np.sqrt(np.diag(first.covariance) / np.diag(covariance)))
    states = np.array([path[0, :n] for path in smoothed.trajectories])
    return Prior(states, first.spread, passed.parameters, covariance * np.outer(wide, wide))


def _alone(after: Array, before: Array) -> Array:
    """Return what the data alone say: the covariance *after* a pass without the information of that *before* it."""
    unit = np.sqrt(np.diag(before))
    w, V = np.linalg.eigh(after / np.outer(unit, unit))
    root = V * np.sqrt(np.maximum(w, 1e-300))
    share, W = np.linalg.eigh(root.T @ np.linalg.inv(before / np.outer(unit, unit)) @ root)
    side = root @ W
    alone: Array = (side / np.maximum(1.0 - share, 1e-3)) @ side.T * np.outer(unit, unit)
    return alone


def settled(before: Levels, after: Levels, smoothed: Smoothed) -> bool:
    """Whether the noise levels stand still, those apart that have become too small to matter."""
    for old, new, rows in (
        (before.noise, after.noise, smoothed.by_noise),
        (before.drive, after.drive, smoothed.by_drive),
    ):
        gain = np.abs(new - old) * np.abs(rows[0] - rows[1])
        if np.any(gain > SETTLED):
            return False
    return True


def _history(task: Task, passed: Passed) -> dict[str, Any]:
    """Return every parameter over the last pass, run by run: stamps, value, standard deviation, thinned."""
    n = len(task.bank.states)
    runs = []
    for track, tape in zip(task.bank.tracks, passed.tapes, strict=True):
        at = thinned(np.arange(len(track.stamps)))
        std = np.sqrt(np.diagonal(tape.covariance[at], axis1=1, axis2=2))
        runs.append(
            {
                "run": track.record.run,
                "t": track.stamps[at].tolist(),
                "value": {f: tape.mean[at, n + i].tolist() for i, f in enumerate(task.bank.free)},
                "std": {f: std[:, n + i].tolist() for i, f in enumerate(task.bank.free)},
            }
        )
    return {"runs": runs}
