"""Find a run of another craft among several, in one of two ways.

If each run alone identifies the craft (one axis), the estimates are compared. The square of their difference, weighted
with both covariances, is chi-squared distributed for the same craft. The run furthest from the rest is removed, and the
remaining ones are compared again. Constant forces, current and delay differ between runs of one craft, so they are not
compared.

For forms with many parameters a cheap test comes first. At the common fit each run has its own gradient ``g_i`` of the
cost, with initial states eliminated. For runs of one craft ``g_i`` has the covariance ``I_i - I_i I^-1 I_i``. ``I_i``
is the information of the run, and ``I`` that of all runs. ``g_i^T (...)^+ g_i`` is then chi-squared distributed. Only
if a run fails this test, each run is left out in turn and the other runs are fitted again. The outlier is the run
without which the others agree.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gcs_autotune import chi_square
from gcs_autotune.identify.problems.likelihood import Limits
from gcs_autotune.identify.problems.reweighting import Effort
from gcs_autotune.identify.problems.solution import Solution, solve_form
from gcs_autotune.identify.signals.segment import Segment
from gcs_autotune.slow_imports import scipy_stats

__all__ = ["CraftEstimate", "DifferentPair", "MisfittingRun", "OutlierRun", "outlier_run", "outlier_runs"]

Array = NDArray[np.float64]

SIGMAS = 6.0
"""Limit for the distance of a run from the others, in standard errors of one parameter.

Project choice. For several parameters, the limit with the same probability is used.
"""
CHANGE = 0.20
"""Smallest relative difference of a parameter for which a run counts as an outlier. Project choice.

Two long runs of one craft may differ significantly by less.
"""

CHANCE = 1e-6
"""Probability of examining runs more closely although they agree. Project choice."""

RELIEF = 1.3
"""Factor by which the noise of at least one signal must decrease if the outlier is left out. Project choice."""

QUICK = Effort(12, exact=False)
"""Effort for fits of some of the runs. They only have to show whether the runs agree."""

MISFIT = 1.5
"""Factor by which the misfit of the outlier, with the model of the other runs, must exceed the noise of those runs.

Project choice.
"""


@dataclass(frozen=True, slots=True, eq=False)
class CraftEstimate:
    """Parameters of the craft estimated from some of the runs.

    - ``values`` (p,): estimates.
    - ``covariance`` (p, p): covariance of ``values``.
    """

    values: Array
    covariance: Array


@dataclass(frozen=True, slots=True)
class OutlierRun:
    """A run that differs from the others, as if it were of another craft.

    - ``run``: name of the run.
    - ``sigmas``: difference from the other runs in standard errors.
    - ``change``: relative change of the parameter that differs most.
    - ``pair``: names of both runs if there are only two, because either may be the outlier. Otherwise None.
    """

    run: str
    sigmas: float
    change: float
    pair: tuple[str, str] | None = None


@dataclass(frozen=True, slots=True)
class MisfittingRun:
    """A run that the model of the other runs does not explain.

    - ``run``: name of the run.
    - ``misfit``: residual of the run with the model of the others, relative to the noise of the others.
    - ``relief``: factor by which the noise decreases if the run is left out.
    """

    run: str
    misfit: float
    relief: float


@dataclass(frozen=True, slots=True)
class DifferentPair:
    """Two runs that need different models.

    - ``runs``: names of both runs.
    - ``relief``: factor by which the noise decreases if each run is fitted separately.
    """

    runs: tuple[str, str]
    relief: float


def outlier_runs(
    names: Sequence[str], estimate: Callable[[tuple[int, ...]], CraftEstimate | None], sigmas: float = SIGMAS
) -> tuple[OutlierRun, ...]:
    """Return one :class:`OutlierRun` for each run whose parameters differ from those of the other runs.

    Parameters
    ----------
    names : names of the runs.
    estimate : function that maps the indices of some runs to one estimate from these runs. It returns None if the runs
        contain too little information.
    """
    alone = [estimate((i,)) for i in range(len(names))]
    left = [i for i, own in enumerate(alone) if own is not None]
    odd: list[OutlierRun] = []
    while len(left) >= 2:
        distances = [_distance(alone[i], estimate(tuple(j for j in left if j != i)), sigmas) for i in left]
        k = int(np.argmax([d for d, _ in distances]))
        distance, change = distances[k]
        if distance <= 0.0:
            break
        pair = (names[left[0]], names[left[1]]) if len(left) == 2 and not odd else None
        odd.append(OutlierRun(names[left[k]], distance, change, pair))
        del left[k]
    return tuple(odd)


def _distance(one: CraftEstimate | None, rest: CraftEstimate | None, sigmas: float) -> tuple[float, float]:
    """Return the distance in standard errors, and the largest relative change of a parameter.

    Both are zero if the estimates agree or cannot be compared.
    """
    if one is None or rest is None:
        return 0.0, 0.0
    difference = one.values - rest.values
    together = one.covariance + rest.covariance
    spread = np.sqrt(np.maximum(np.diag(together), 0.0))
    known = np.isfinite(spread) & (spread > 0.0)
    if not known.any():
        return 0.0, 0.0
    d, scale = difference[known] / spread[known], spread[known]
    correlation = together[np.ix_(known, known)] / np.outer(scale, scale)
    square = float(d @ np.linalg.pinv(correlation, rcond=1e-9, hermitian=True) @ d)
    limit = chi_square.threshold(chi_square.exceeded_by_chance(sigmas**2, 1), int(known.sum()))
    certain = np.abs(d) > 3.0
    size = np.maximum(np.abs(rest.values[known]), 1e-300)
    change = float(np.max(np.abs(difference[known]) / size, where=certain, initial=0.0))
    if square <= limit or change <= CHANGE:
        return 0.0, 0.0
    return math.sqrt(square), change


def outlier_run(solution: Solution, records: Sequence[Segment], limits: Limits) -> MisfittingRun | DifferentPair | None:
    """Return the run that differs from the others, both runs of a pair that differ, or None if all agree."""
    runs = list(dict.fromkeys(r.run for r in records))
    if len(runs) < 2 or not solution.free or max(_strangeness(solution, records, runs)) < -np.log(CHANCE):
        return None
    if len(runs) == 2:
        return _two_apart(solution, records, runs, limits)
    best: tuple[float, float, str] | None = None
    for run in runs:
        rest = [i for i, r in enumerate(records) if r.run != run]
        alone = _fitted(solution, records, rest, limits)
        if alone is None:
            continue
        relief = max(solution.noise[n] / alone.noise[n] for n in alone.noise)
        own = [i for i in range(len(records)) if i not in rest]
        misfit = _misfit(alone, solution, records, own)
        if relief > RELIEF and misfit > MISFIT and (best is None or relief > best[0]):
            best = (relief, misfit, run)
    if best is None:
        return None
    relief, misfit, run = best
    return MisfittingRun(run, misfit, relief)


def _two_apart(
    solution: Solution, records: Sequence[Segment], runs: Sequence[str], limits: Limits
) -> DifferentPair | None:
    """Return the two runs if they differ. With only two, neither can be identified as the outlier."""
    relief = np.inf
    for run in runs:
        alone = _fitted(solution, records, [i for i, r in enumerate(records) if r.run == run], limits)
        if alone is None:
            return None
        relief = min(relief, max(solution.noise[n] / alone.noise[n] for n in alone.noise))
    return None if relief < RELIEF else DifferentPair((runs[0], runs[1]), float(relief))


def _strangeness(solution: Solution, records: Sequence[Segment], runs: Sequence[str]) -> list[float]:
    """Return minus the logarithm of the probability of each run's gradient.

    The correlation of the residuals is taken into account.
    """
    k, total, parts = len(solution.names), None, []
    for run in runs:
        mine = [i for i, r in enumerate(records) if r.run == run]
        J = np.vstack([J for r, J in zip(solution.rests, solution.rows, strict=True) if r.segment in mine])
        e = np.concatenate([s for r, s in zip(solution.rests, solution.scores, strict=True) if r.segment in mine])
        states = J[:, k:][:, np.any(J[:, k:] != 0.0, axis=0)]
        if states.shape[1]:
            basis, _ = np.linalg.qr(states)
            shared = J[:, :k] - basis @ (basis.T @ J[:, :k])
        else:
            shared = J[:, :k]
        information = shared.T @ shared
        parts.append((information, shared.T @ e))
        total = information if total is None else total + information
    assert total is not None
    scale = 1.0 / np.sqrt(np.maximum(np.diag(total), 1e-300))
    inverse = np.linalg.pinv(total * np.outer(scale, scale), rcond=1e-10, hermitian=True)
    strangeness = []
    for information, g in parts:
        I = information * np.outer(scale, scale)  # noqa: E741 - the field's name for an information
        spread = (I - I @ inverse @ I) * solution.correlation
        values, vectors = np.linalg.eigh(spread)
        loose = values > 1e-8 * max(float(values[-1]), 1e-300)
        statistic = float(np.sum((vectors.T @ (g * scale))[loose] ** 2 / values[loose]))
        strangeness.append(-float(scipy_stats().chi2.logsf(statistic, int(loose.sum()))))
    return strangeness


def _fitted(solution: Solution, records: Sequence[Segment], chosen: Sequence[int], limits: Limits) -> Solution | None:
    chosen_records = [records[i] for i in chosen]
    levels = {n: v for n, v in solution.noise.items() if any(n in r.signals for r in chosen_records)}
    initial = [solution.initial[i] for i in chosen]
    return solve_form(solution.form, chosen_records, solution.theta, initial, limits, levels=levels, effort=QUICK)


def _misfit(alone: Solution, solution: Solution, records: Sequence[Segment], own: Sequence[int]) -> float:
    """Return the ratio of the misfit of the runs *own* to the noise of *alone*, the solution of the others.

    Only the initial states of *own* are fitted.
    """
    initial = [solution.initial[i] for i in own]
    levels = {n: v for n, v in alone.noise.items() if any(n in records[i].signals for i in own)}
    chosen = [records[i] for i in own]
    refitted = solve_form(
        alone.form, chosen, alone.theta, initial, Limits({}, {}), levels=levels, free=(), effort=QUICK
    )
    if refitted is None:
        return float("inf")
    return max((refitted.noise[n] / alone.noise[n] for n in refitted.noise if n in alone.noise), default=0.0)
