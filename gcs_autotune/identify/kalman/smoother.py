"""Iterated smoother: estimate all states of all runs and the parameters at once, by Gauss-Newton.

Each round linearises the equations about the smoothed trajectories and parameters of the round before. It then runs
forwards and backwards, and fits the noise levels to the residuals. The samples constrain the trajectories in every
round. A bad start therefore cannot make the motion diverge, and velocities can be estimated from positions alone.

Source: Bell1994.
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
from gcs_autotune.identify.kalman.report import FilterEstimate, report, thinned
from gcs_autotune.identify.kalman.task import OPTIONS, Task, task_of
from gcs_autotune.identify.method import Method
from gcs_autotune.identify.result import Fit
from gcs_autotune.models import CoupledModel, inertia_matrix

__all__ = ["METHOD", "SMOOTHER_OPTIONS", "Ended", "fit_by_smoother", "iterate", "positive_inertia", "settled"]

Array = NDArray[np.float64]

SMOOTHER_OPTIONS = (*OPTIONS, ("rounds", "most rounds (60)"))

ROUNDS = 60
"""Maximum number of rounds of the smoother.

Parameters need five to ten; noise levels that go to zero need up to forty. Project choice.
"""

WIDE = 10.0
"""Factor by which the prior standard deviations of the parameters are increased for the smoother. Project choice.

It is large, because linearisation about a trajectory needs no prior information.
"""


RETREATS = 6
"""Maximum number of times that a diverged round is repeated with half the step. Project choice."""

SETTLED = 0.02
"""Limit below which the rounds end. Project choice.

It applies to the last change of each parameter in standard errors, and to the gain of log-likelihood by new noise
levels.
"""


@dataclass(frozen=True, slots=True, eq=False)
class Ended:
    """Result of the last round of the smoother.

    - ``result``: the last filter pass.
    - ``smoothed``: the smoothed states.
    - ``levels``: noise levels.
    - ``moved`` (p,): change of each parameter in the last round, in standard errors.
    - ``count``: number of rounds.
    - ``settled``: whether parameters and levels have settled.
    """

    result: FilterResult
    smoothed: Smoothed
    levels: Levels
    moved: Array
    rounds: int
    settled: bool


def fit_by_smoother(case: Case) -> Fit[CoupledModel]:
    """Return a coupled model fitted to *case* by the iterated smoother.

    The option ``rounds`` limits the number of rounds.
    """
    task = task_of(case)
    rounds = int(case.options.get("rounds", ROUNDS))
    if rounds < 1:
        raise UsageError(f"rounds must be 1 or more, not {rounds}")
    ended = iterate(task, rounds)
    result = ended.result
    estimate = FilterEstimate(
        result.parameters,
        result.covariance,
        np.sqrt(np.diag(result.covariance)),
        ended.levels,
        result,
        ended.moved,
        extra={"rounds": ended.rounds, "smoothed": _smoothed(task, ended.smoothed)},
    )
    return report(task, "smoother", estimate)


def iterate(task: Task, rounds: int) -> Ended:
    """Return the result of the smoother after at most *rounds* rounds, starting from the regression.

    If the rounds do not settle, a second start without drag is tried.

    Raises
    ------
    NotInformative
        The first round diverged.
    """
    ended = _rounds(task, task.start.theta, rounds)
    if ended is None or not ended.settled:
        other = _rounds(task, task.start.cautious, rounds)
        if other is not None and (ended is None or _rank(other) > _rank(ended)):
            ended = other
    if ended is None:
        raise NotInformative(
            f"the smoother of '{task.bank.form.name}' diverged on run '{task.case.names[0]}'. Supply start values "
            "(start=...)"
        )
    return ended


def _rank(ended: Ended) -> tuple[bool, float]:
    return ended.settled, ended.result.log_likelihood


def _rounds(task: Task, theta: Array, rounds: int) -> Ended | None:
    """Return the result of at most *rounds* rounds from *theta*, or None if the first round diverges."""
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
    """Return whether the noise levels have settled between *before* and *after*.

    Levels that are too small to matter are ignored.
    """
    for old, new, rows in (
        (before.noise, after.noise, smoothed.by_noise),
        (before.drive, after.drive, smoothed.by_drive),
    ):
        gain = np.abs(new - old) * np.abs(rows[0] - rows[1])
        if np.any(gain > SETTLED):
            return False
    return True


def positive_inertia(task: Task, parameters: Array) -> bool:
    """Return whether the inertia with the free *parameters* (p,) is positive definite."""
    active = task.bank.program.active
    M = inertia_matrix(task.bank.form, task.theta(parameters))[np.ix_(active, active)]
    return bool(np.all(np.linalg.eigvalsh(0.5 * (M + M.T)) > 0.0))


def _within(task: Task, here: Array, there: Array) -> Array:
    """Return *there*, or the nearest tried point between *here* and *there* with positive definite inertia."""
    for _ in range(20):
        if positive_inertia(task, there):
            return there
        there = 0.5 * (here + there)
    return here


def _smoothed(task: Task, smoothed: Smoothed) -> list[dict[str, Any]]:
    """Return the smoothed states of every run and their standard deviations, thinned."""
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
    "iterated smoother that needs only positions",
    axis=for_axis(fit_by_smoother),
    coupled=fit_by_smoother,
    options=SMOOTHER_OPTIONS,
    bears=frozenset({"stamps"}),
)
