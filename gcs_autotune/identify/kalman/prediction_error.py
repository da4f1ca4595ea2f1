"""Fit parameters, measurement noise and process noise together by maximum likelihood (prediction-error method).

A Kalman filter with known parameters predicts each sample. The log-likelihood of its innovations is
``-1/2 sum(e^2/S + ln 2 pi S)``.

Each derivative by a parameter is a difference of two whole filter passes. It therefore includes how the gain and the
innovation variances depend on that parameter. Steps and covariance come from the information matrix ``sum(de de'/S + dS
dS'/(2 S^2))``. The search starts at the result of the iterated smoother.

Source: Ljung1999, chapter 7.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.errors import UsageError
from gcs_autotune.identify.case import Case
from gcs_autotune.identify.coupled.one_axis import for_axis
from gcs_autotune.identify.kalman.filter_bank import FilterBank, FilterResult, Levels, Prior
from gcs_autotune.identify.kalman.report import FilterEstimate, report
from gcs_autotune.identify.kalman.smoother import iterate
from gcs_autotune.identify.kalman.task import OPTIONS, Task, first_states, task_of
from gcs_autotune.identify.method import Method
from gcs_autotune.identify.problems.least_squares import inverse_of
from gcs_autotune.identify.result import Fit
from gcs_autotune.models import CoupledModel

__all__ = ["METHOD", "PEM_OPTIONS", "fit_by_prediction_error"]

Array = NDArray[np.float64]

PEM_OPTIONS = (*OPTIONS, ("rounds", "maximum number of scoring rounds (20)"))

ROUNDS = 20
"""Maximum number of scoring rounds. Three to six suffice from the smoother's result. Project choice."""

STEP = 1e-2
"""Length of a finite difference, in standard errors of the parameter. Project choice.

The log-likelihood is nearly a parabola over this length.
"""

ENOUGH = 1e-3
"""Expected gain of the log-likelihood below which the search ends.

It corresponds to a thousandth of a standard error. Project choice.
"""

SMOOTHER_ROUNDS = 30
"""Maximum number of rounds of the smoother that provides the start. Project choice."""

ACTIVE = 1e-3
"""Smallest influence of process noise on the likelihood for which its intensity is estimated. Project choice.

The influence is the intensity times its score row. Below this value the process noise is set to zero.
"""


@dataclass(frozen=True, slots=True, eq=False)
class _Point:
    """Point of the search: free parameters (p,) and logarithms of the noise levels to be estimated (l,)."""

    parameters: Array
    logs: Array


class _Likelihood:
    """Log-likelihood of a task as a function of its unknowns, with score and information."""

    def __init__(self, task: Task, levels: Levels, states: Array, spread: Array) -> None:
        self.task, self.levels = task, levels
        self.bank: FilterBank = task.bank.with_free(())
        nothing = np.zeros(0)
        self.prior = Prior(states, spread, nothing, np.zeros((0, 0)))
        m = len(levels.noise)
        sought = list(range(m)) if task.tune_noise else []
        if task.tune_drive:
            sought += [m + int(i) for i in np.flatnonzero(levels.drive > 0.0)]
        self.sought = np.array(sought, dtype=np.int64)

    def start(self, parameters: Array) -> _Point:
        """Return the point with *parameters* and the noise levels of the task."""
        return _Point(parameters, np.log(np.concatenate([self.levels.noise, self.levels.drive])[self.sought]))

    def levels_at(self, point: _Point) -> Levels:
        """Return all noise levels at *point*."""
        m, together = len(self.levels.noise), np.concatenate([self.levels.noise, self.levels.drive])
        together[self.sought] = np.exp(point.logs)
        noise = np.maximum(together[:m], self.task.start.floors)
        return Levels(noise, together[m:], np.zeros(0))

    def at(self, point: _Point, *, full: bool = False) -> FilterResult | None:
        """Return the filter's pass at *point*, or None if the motion diverges.

        The log-likelihood includes the prior of a shift of stamps.
        """
        result = self.bank.run(self.task.theta(point.parameters), self.prior, self.levels_at(point), full=full)
        if result is None or self.task.stamps is None:
            return result
        off, weight = self._shift(point)
        return replace(result, log_likelihood=result.log_likelihood - 0.5 * weight * off**2)

    def _shift(self, point: _Point) -> tuple[float, float]:
        """Return the deviation of the shift of stamps from its prior value, and the information of the prior."""
        at = self.task.bank.free.index("delay")
        std = self.task.spread * float(self.task.start.scale[at])
        return float(point.parameters[at]) - float(self.task.stamps or 0.0), std**-2

    def score(self, point: _Point, here: FilterResult, steps: Array) -> tuple[Array, Array]:
        """Return the gradient (p + l,) of the log-likelihood at *point*, and the information (p + l, p + l).

        The unknowns are the parameters, then the logarithms of the noise levels.

        here : filter pass at *point*.
        steps : (p + l,) lengths of the finite differences.
        """
        e, S = here.innovations
        seen = ~np.isnan(S)
        e, S = e[seen], S[seen]
        p, J, D = len(point.parameters), [], []
        for i, step in enumerate(steps):
            for sign in (1.0, -1.0):
                moved = self.at(_moved(point, p, i, sign * step))
                if moved is not None:
                    break
            if moved is None:
                J.append(np.zeros_like(e))
                D.append(np.zeros_like(e))
                continue
            e_1, S_1 = (a[seen] for a in moved.innovations)
            J.append((e_1 - e) / (sign * step))
            D.append((S_1 - S) / (sign * step))
        j, d = np.array(J), np.array(D)
        gradient = -(j @ (e / S)) - 0.5 * d @ ((1.0 - e * e / S) / S)
        information = (j / S) @ j.T + 0.5 * (d / S**2) @ d.T
        if self.task.stamps is not None:
            at = self.task.bank.free.index("delay")
            off, weight = self._shift(point)
            gradient[at] -= weight * off
            information[at, at] += weight
        return gradient, information


def fit_by_prediction_error(case: Case) -> Fit[CoupledModel]:
    """Return a coupled model fitted to *case* by the prediction-error method.

    Process and measurement noise are fitted together with the parameters.
    """
    task = task_of(case)
    rounds = int(case.options.get("rounds", ROUNDS))
    if rounds < 1:
        raise UsageError(f"rounds must be 1 or more, not {rounds}")
    ended = iterate(task, SMOOTHER_ROUNDS)
    prior = first_states(ended.smoothed, task.start.spread)
    likelihood = _Likelihood(task, _thresholded(ended.levels, ended.smoothed.by_drive), *prior)
    point = likelihood.start(ended.result.parameters)
    here = likelihood.at(point)
    if here is None:
        return report(task, "prediction-error", _as_it_was(ended.result, ended.levels))
    p = len(point.parameters)
    std = np.concatenate([np.sqrt(np.diag(ended.result.covariance)), np.full(len(point.logs), 0.2)])
    moved, covariance, count = np.zeros(p), ended.result.covariance, 0
    while count < rounds:
        count += 1
        gradient, information = likelihood.score(point, here, STEP * std)
        guard = np.concatenate([(task.spread * task.start.scale) ** -2.0 * 1e-2, np.full(len(point.logs), 1e-2)])
        whole = inverse_of(information + np.diag(guard))
        covariance, std = whole[:p, :p], np.minimum(np.sqrt(np.diag(whole)), 10.0 * std)
        step = whole @ gradient
        step[p:] = np.clip(step[p:], -2.0, 2.0)
        better, reached, length = _line(likelihood, point, here, step)
        moved = np.abs(length * step[:p]) / np.sqrt(np.diag(covariance))
        gain = 0.5 * float(gradient @ whole @ gradient)
        if better is None:
            break
        point, here = reached, better
        if gain < ENOUGH:
            break
    levels = likelihood.levels_at(point)
    last = likelihood.at(point, full=True) or here
    estimate = FilterEstimate(
        point.parameters,
        covariance,
        np.sqrt(np.diag(covariance)),
        replace(levels, walk=np.zeros(p)),
        last,
        moved,
        extra={"rounds": count},
    )
    return report(task, "prediction-error", estimate)


def _moved(point: _Point, p: int, i: int, by: float) -> _Point:
    parameters, logs = point.parameters.copy(), point.logs.copy()
    if i < p:
        parameters[i] += by
    else:
        logs[i - p] += by
    return _Point(parameters, logs)


def _line(
    likelihood: _Likelihood, point: _Point, here: FilterResult, step: Array
) -> tuple[FilterResult | None, _Point, float]:
    """Return the first more likely point along *step*, which is halved if necessary.

    Also return its pass and the fraction of the step. Without such a point, return None, *point* and 0.
    """
    p, length = len(point.parameters), 1.0
    for _ in range(12):
        trial = _Point(point.parameters + length * step[:p], point.logs + length * step[p:])
        there = likelihood.at(trial)
        if there is not None and there.log_likelihood >= here.log_likelihood:
            return there, trial, length
        length *= 0.5
    return None, point, 0.0


def _thresholded(levels: Levels, by_drive: Array) -> Levels:
    """Return levels with negligible process noise set to zero.

    There the score shows that less noise is more likely.
    """
    share = levels.drive * by_drive[1]
    return replace(levels, drive=np.where(share > ACTIVE, levels.drive, 0.0))


def _as_it_was(result: FilterResult, levels: Levels) -> FilterEstimate:
    std = np.sqrt(np.diag(result.covariance))
    return FilterEstimate(result.parameters, result.covariance, std, levels, result, np.full(len(std), np.inf))


METHOD = Method(
    "prediction-error",
    "maximum likelihood of the innovations. It separates process noise such as gusts from measurement noise",
    axis=for_axis(fit_by_prediction_error),
    coupled=fit_by_prediction_error,
    options=PEM_OPTIONS,
    bears=frozenset({"stamps"}),
)
