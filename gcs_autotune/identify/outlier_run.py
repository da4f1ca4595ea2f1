"""A run of another craft among the rest: found by what the others say without it. Two ways.

Where each run by itself tells the craft (one axis), the estimates are compared: their difference, weighed with both
covariances, is chi-squared distributed when the craft is the same. The run furthest from the rest is taken out and the
remaining ones are compared again. Constant forces, current and delay belong to the day, not to the craft: they are left
out of the estimates.

Where it does not (forms of many parameters), first cheaply: at the common fit every run pulls the parameters its own
way, ``g_i`` (the gradient of its cost, initial states eliminated). Were all runs of one craft, ``g_i`` would have the
covariance ``I_i - I_i I^-1 I_i`` with ``I_i`` its information and ``I`` that of all, so ``g_i^T (...)^+ g_i`` is
chi-squared. Only when some run stands out so is each left out in turn and the rest fitted again: the odd one is that
whose absence lets the others agree.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gcs_autotune import chi_square
from gcs_autotune.identify.likelihood import Limits
from gcs_autotune.identify.result import Doubt
from gcs_autotune.identify.reweighting import Effort
from gcs_autotune.identify.segment import Segment
from gcs_autotune.identify.solution import Solution, solve_form
from gcs_autotune.slow_imports import scipy_stats

__all__ = ["CraftEstimate", "OutlierRun", "outlier_run", "outlier_run_doubts", "outlier_runs"]

Array = NDArray[np.float64]

SIGMAS = 6.0
"""Chosen: a run counts as apart when its distance is less likely than six standard errors of one number."""
CHANGE = 0.20
"""And when a parameter differs by this share: two long runs of one craft show small differences of no account."""

CHANCE = 1e-6
"""Chance of looking closer at runs that do agree."""

RELIEF = 1.3
"""Without the odd run the noise of some signal falls by this factor at least."""

QUICK = Effort(12, exact=False)
"""Fits of some of the runs only have to tell agreement from disagreement."""

MISFIT = 1.5
"""And the odd run, simulated with what the others say, misses by this many times their noise at least."""


@dataclass(frozen=True, slots=True, eq=False)
class CraftEstimate:
    """What some of the runs say about the craft: ``values`` (p,), ``covariance`` (p, p)."""

    values: Array
    covariance: Array


@dataclass(frozen=True, slots=True)
class OutlierRun:
    """A run that speaks of another craft, ``sigmas`` standard errors from the others; ``change`` of the parameter
    that differs most, as a share. ``pair`` holds both names when there are only two runs and either may be the odd one.
    """

    run: str
    sigmas: float
    change: float
    pair: tuple[str, str] | None = None


def outlier_runs(
    names: Sequence[str], estimate: Callable[[tuple[int, ...]], CraftEstimate | None], sigmas: float = SIGMAS
) -> tuple[OutlierRun, ...]:
    """Return the runs that do not belong to the others.

    Parameters
    ----------
    names : of the runs.
    estimate : what the runs of these indices say together; None when they cannot tell.
    """
    alone = [estimate((i,)) for i in range(len(names))]
    left = [i for i, found in enumerate(alone) if found is not None]
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
    """Return distance in standard errors and largest relative change; zeros when they agree or cannot be compared."""
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


def outlier_run_doubts(found: Sequence[OutlierRun]) -> list[Doubt]:
    """Return one doubt per run apart, the run named."""
    return [
        Doubt(
            "run-apart",
            f"runs '{a.pair[0]}' and '{a.pair[1]}' differ by {a.sigmas:.0f} standard errors: they speak of two crafts"
            if a.pair
            else f"run '{a.run}' differs from the others by {a.sigmas:.0f} standard errors: it speaks of another craft",
            "was it another vehicle, load, speed or battery? identify the odd run by itself",
        )
        for a in found
    ]


def outlier_run(solution: Solution, records: Sequence[Segment], limits: Limits) -> Doubt | None:
    """Return a doubt that names the run which does not belong to the rest, None when all agree."""
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
    return Doubt(
        "run-apart",
        f"run '{run}' does not fit the others: a model of theirs misses it by {misfit:.1f} times their noise, and "
        f"without it the noise falls by a factor {relief:.1f}",
        f"leave '{run}' out: it may be of another vehicle, load or input scale; identify it by itself",
    )


def _two_apart(solution: Solution, records: Sequence[Segment], runs: Sequence[str], limits: Limits) -> Doubt | None:
    """Of two runs none can be called the odd one; they can only be called different."""
    relief = np.inf
    for run in runs:
        alone = _fitted(solution, records, [i for i, r in enumerate(records) if r.run == run], limits)
        if alone is None:
            return None
        relief = min(relief, max(solution.noise[n] / alone.noise[n] for n in alone.noise))
    if relief < RELIEF:
        return None
    return Doubt(
        "runs-disagree",
        f"runs '{runs[0]}' and '{runs[1]}' speak for different models: each alone is fitted {relief:.1f} times better",
        "did load, speed or battery change between the runs? identify them one by one, or fly a third",
    )


def _strangeness(solution: Solution, records: Sequence[Segment], runs: Sequence[str]) -> list[float]:
    """Return minus the logarithm of each run's chance, residuals' correlation allowed for."""
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
    found = []
    for information, g in parts:
        I = information * np.outer(scale, scale)  # noqa: E741 - the field's name for an information
        spread = (I - I @ inverse @ I) * solution.correlation
        values, vectors = np.linalg.eigh(spread)
        loose = values > 1e-8 * max(float(values[-1]), 1e-300)
        statistic = float(np.sum((vectors.T @ (g * scale))[loose] ** 2 / values[loose]))
        found.append(-float(scipy_stats().chi2.logsf(statistic, int(loose.sum()))))
    return found


def _fitted(solution: Solution, records: Sequence[Segment], chosen: Sequence[int], limits: Limits) -> Solution | None:
    chosen_records = [records[i] for i in chosen]
    levels = {n: v for n, v in solution.noise.items() if any(n in r.signals for r in chosen_records)}
    initial = [solution.initial[i] for i in chosen]
    return solve_form(solution.form, chosen_records, solution.theta, initial, limits, levels=levels, effort=QUICK)


def _misfit(alone: Solution, solution: Solution, records: Sequence[Segment], own: Sequence[int]) -> float:
    """Return by how many times *alone*'s noise the runs *own* are missed with its parameters, states fitted."""
    initial = [solution.initial[i] for i in own]
    levels = {n: v for n, v in alone.noise.items() if any(n in records[i].signals for i in own)}
    chosen = [records[i] for i in own]
    found = solve_form(alone.form, chosen, alone.theta, initial, Limits({}, {}), levels=levels, free=(), effort=QUICK)
    if found is None:
        return float("inf")
    return max((found.noise[n] / alone.noise[n] for n in found.noise if n in alone.noise), default=0.0)
