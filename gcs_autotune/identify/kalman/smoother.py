"""Iterated smoother: all states of all runs and the parameters at once, by Gauss-Newton.

Each round linearises the equations about the smoothed trajectories and parameters of the round before (not about a
filter's half-informed estimate), runs forwards and backwards, and fits the noise levels to what is left. With the
trajectories tied to the samples from the first round on, a bad start cannot send the motion astray, and velocities come
out of positions alone.

Bell1994.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.errors import NotInformative, UsageError
from gcs_autotune.identify.case import Case
from gcs_autotune.identify.coupled.one_axis import for_axis
from gcs_autotune.identify.kalman.filter_bank import FilterResult, Levels, Smoothed
from gcs_autotune.identify.kalman.report import Found, report, thinned
from gcs_autotune.identify.kalman.task import OPTIONS, Task, task_of
from gcs_autotune.identify.method import Method
from gcs_autotune.identify.result import Fit
from gcs_autotune.models import CoupledModel, inertia_matrix

__all__ = ["METHOD", "SMOOTHER_OPTIONS", "Ended", "fit_by_smoother", "iterate", "positive_inertia", "settled"]

Array = NDArray[np.float64]

SMOOTHER_OPTIONS = (*OPTIONS, ("rounds", "most rounds (60)"))

ROUNDS = 60
"""Most rounds. Chosen: parameters need five to ten, levels that go to zero up to forty."""

WIDE = 10.0
"""Prior spread in natural scales: linearised about a trajectory the answer needs no guidance from it."""


RETREATS = 6
"""Times a round that ran away is tried again half way back."""

SETTLED = 0.02
"""Move in standard errors, and gain of the log likelihood by the levels, at which rounds end."""


@dataclass(frozen=True, slots=True, eq=False)
class Ended:
    """Where the rounds ended: last pass, smoothed states, levels, last moves (p,) in standard errors, how many rounds,
    and whether parameters and levels stood still."""

    result: FilterResult
    smoothed: Smoothed
    levels: Levels
    moved: Array
    rounds: int
    settled: bool


def fit_by_smoother(case: Case) -> Fit[CoupledModel]:
    """Fit by the iterated smoother; *case* and result as every method for coupled models."""
    task = task_of(case)
    rounds = int(case.options.get("rounds", ROUNDS))
    if rounds < 1:
        raise UsageError(f"rounds must be 1 or more, not {rounds}")
    ended = iterate(task, rounds)
    result = ended.result
    found = Found(
        result.parameters,
        result.covariance,
        np.sqrt(np.diag(result.covariance)),
        ended.levels,
        result,
        ended.moved,
        extra={"rounds": ended.rounds, "smoothed": _smoothed(task, ended.smoothed)},
    )
    return report(task, "smoother", found)


def iterate(task: Task, rounds: int) -> Ended:
    """Return where at most *rounds* rounds lead: from the regression, and should that not settle, without any drag.

    Raises
    ------
    NotInformative
        Even the first round ran away.
    """
    ended = _rounds(task, task.start.theta, rounds)
    if ended is None or not ended.settled:
        other = _rounds(task, task.start.cautious, rounds)
        if other is not None and (ended is None or _rank(other) > _rank(ended)):
            ended = other
    if ended is None:
        raise NotInformative(
            f"the smoother found no motion of '{task.bank.form.name}' near run '{task.case.names[0]}': "
            "give start values (start=...)"
        )
    return ended


def _rank(ended: Ended) -> tuple[bool, float]:
    return ended.settled, ended.result.log_likelihood


def _rounds(task: Task, theta: Array, rounds: int) -> Ended | None:
    """Run at most *rounds* rounds from *theta*; None when even the first runs away."""
    bank, prior = task.bank, task.prior
    prior = replace(prior, covariance=task.widened(WIDE))
    here, paths, levels = theta[bank.places], task.start.paths, task.start.levels
    ended, last, retreats = None, here, 0
    for count in range(1, rounds + 1):
        result = bank.run(task.theta(here), prior, levels, about=paths, full=True)
        if result is None:
            if ended is None or retreats == RETREATS:
                break
            here, retreats = 0.5 * (here + last), retreats + 1
            continue
        last = here
        smoothed = bank.smooth(result, levels)
        there = _within(task, here, result.parameters)
        moved = np.abs(there - here) / np.sqrt(np.diag(result.covariance))
        after = task.tuned(levels, smoothed)
        done = bool(np.all(moved < SETTLED)) and settled(levels, after, smoothed)
        ended = Ended(replace(result, parameters=there), smoothed, levels, moved, count, done)
        if done:
            break
        n = len(bank.states)
        here, levels, paths = there, after, tuple(path[:, :n] for path in smoothed.trajectories)
    return ended


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


def positive_inertia(task: Task, parameters: Array) -> bool:
    """Whether the inertia of free *parameters* (p,) is positive definite."""
    active = task.bank.program.active
    M = inertia_matrix(task.bank.form, task.theta(parameters))[np.ix_(active, active)]
    return bool(np.all(np.linalg.eigvalsh(0.5 * (M + M.T)) > 0.0))


def _within(task: Task, here: Array, there: Array) -> Array:
    """Return *there*, or a point on the way where the inertia is still positive definite."""
    for _ in range(20):
        if positive_inertia(task, there):
            return there
        there = 0.5 * (here + there)
    return here


def _smoothed(task: Task, smoothed: Smoothed) -> list[dict[str, Any]]:
    """Return the smoothed states of every run with their standard deviations, thinned."""
    runs = []
    for track, path, var in zip(task.bank.tracks, smoothed.trajectories, smoothed.variances, strict=True):
        at = thinned(np.arange(len(track.stamps)))
        runs.append(
            {
                "run": track.record.name,
                "t": track.stamps[at].tolist(),
                "value": {s: path[at, i].tolist() for i, s in enumerate(task.bank.states)},
                "std": {s: np.sqrt(var[at, i]).tolist() for i, s in enumerate(task.bank.states)},
            }
        )
    return runs


METHOD = Method(
    "smoother",
    "iterated smoother: positions alone will do",
    axis=for_axis(fit_by_smoother),
    coupled=fit_by_smoother,
    options=SMOOTHER_OPTIONS,
    bears=frozenset({"stamps"}),
)
