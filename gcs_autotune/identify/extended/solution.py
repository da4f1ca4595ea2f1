"""A fit with effects as a :class:`CoupledSolution`: covariances, colour and doubts are those of every coupled fit."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.identify.axis.likelihood import gaussian_laws
from gcs_autotune.identify.axis.residuals import Residual
from gcs_autotune.identify.coupled.output_error import CoupledSolution, inflation_of, near_bound
from gcs_autotune.identify.extended.fitting import Fitted, Problem
from gcs_autotune.identify.extended.wish import label_of
from gcs_autotune.identify.least_squares import inverse_of
from gcs_autotune.identify.segment import Signal

__all__ = ["solution_of"]

Array = NDArray[np.float64]


def solution_of(problem: Problem, fitted: Fitted) -> CoupledSolution:
    """Return *fitted* with the uncertainty of its numbers; ``free`` are base parameters, then labels of effects'.

    Noise levels are raised for the numbers fitted. What stands at a bound is taken as known there.
    """
    names = (*fitted.free, *(label_of(fitted.effects[i], n) for i, n in fitted.free_effects))
    spent = math.sqrt(fitted.samples / max(fitted.samples - fitted.jacobian.shape[1], 1))
    levels = {n: level * spent for n, level in fitted.levels.items()}
    residuals, rows, scores, at = [], [], [], 0
    for rest in fitted.rests:
        good = np.isfinite(rest.judged)
        count = int(good.sum())
        J = fitted.jacobian[at : at + count] / spent
        at += count
        if count == 0:
            continue
        step = problem.segments[rest.segment].signals[rest.signal].step
        signal = Signal(rest.signal, rest.t[good], rest.measured[good], step)
        residuals.append(Residual(rest.segment, signal, rest.judged[good], J))
        rows.append(J)
        scores.append(rest.judged[good] / levels[rest.signal])
    low, high = problem.edges(fitted.effects, fitted.free_effects)
    at_bound = near_bound(names, fitted.shared, low, high)
    information = sum((J.T @ J for J in rows), np.zeros((fitted.jacobian.shape[1],) * 2))
    if fitted.slack:
        information[-1, -1] += fitted.slack**-2
    whole, blind = _covariance(information, names, at_bound)
    return CoupledSolution(
        form=fitted.form,
        theta=fitted.theta,
        free=names,
        initial=fitted.initial,
        laws=gaussian_laws(levels),
        residuals=tuple(residuals),
        rows=tuple(rows),
        scores=tuple(scores),
        whole=whole,
        factors=inflation_of(whole, scores, rows, len(names)),
        log_likelihood=_log_likelihood(fitted),
        cost=fitted.cost,
        n=fitted.samples,
        converged=fitted.converged,
        at_bound=at_bound,
        blind=blind,
    )


def _covariance(information: Array, names: tuple[str, ...], at_bound: tuple[str, ...]) -> tuple[Array, tuple[str, ...]]:
    seen = np.diag(information) > 0.0
    loose = seen.copy()
    loose[: len(names)] &= np.array([n not in at_bound for n in names], dtype=bool)
    whole = np.zeros_like(information)
    whole[np.ix_(loose, loose)] = inverse_of(information[np.ix_(loose, loose)])
    return whole, tuple(n for n, s in zip(names, seen[: len(names)], strict=True) if not s)


def _log_likelihood(fitted: Fitted) -> float:
    """Return the logarithm of the likelihood at the likeliest noise levels (disturbances' penalties aside)."""
    counts = dict.fromkeys(fitted.levels, 0)
    for rest in fitted.rests:
        counts[rest.signal] += int(np.isfinite(rest.judged).sum())
    return -0.5 * sum(n * (math.log(math.tau * fitted.levels[s] ** 2) + 1.0) for s, n in counts.items())
