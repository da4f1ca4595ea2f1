"""Held-out gain of a cause with process noise modelled: log-likelihood, and prediction error some seconds ahead."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from gcs_autotune.diagnose.heldout import BLOCKS, FEWEST
from gcs_autotune.diagnose.result import ErrorReduction
from gcs_autotune.diagnose.sampling_interval import horizons, prediction_horizon, refitted
from gcs_autotune.identify.kalman import NoisyFit, NoisyProblem
from gcs_autotune.identify.signals import Segment
from gcs_autotune.sname import SIGNALS

__all__ = ["Folds", "densities_of", "gains_ahead", "interval_of", "unseen_of"]

Array = NDArray[np.float64]

Folds = tuple[tuple[tuple[Segment, ...], tuple[Segment, ...]], ...]
"""Folds of the runs: for each fold, the segments to fit and the segments to predict."""

Unseen = Sequence[NoisyFit | None]
"""For each fold, a model refitted without the fold and evaluated on it; None if the filter diverges."""

REFIT = 4
"""Maximum number of scoring iterations of a refit without one run."""

RUNS_AWAY = -1e6
"""Log density assigned to the samples of a model that diverges."""

FAR_ROUGHER = 2.0
"""Limit for unusual process noise in a held-out fold.

It is the ratio of squared held-out innovations to their expected size. Above it the part has its own noise level.
"""

FEWEST_WHOLES = 4
"""Minimum number of held-out folds to estimate their scatter. Two or three are often similar by chance."""

SURE = 0.95
"""Quantile of the 90 % interval of a gain: 5 % lie above its upper limit."""


def unseen_of(problem: NoisyProblem, plain: NoisyFit, folds: Folds, fit: NoisyFit) -> Unseen:
    """Return *fit*, for each fold, refitted without the fold and evaluated on it.

    plain : the model without any cause. It determines the prediction horizon at which refits are compared.
    """
    seconds, judged = prediction_horizon(problem, plain), []
    for train, test in folds:
        again = refitted(problem.on(train), fit, REFIT, seconds)
        judged.append(None if again is None else problem.on(test).judge(again))
    return judged


def densities_of(fits: Unseen, plain: Unseen) -> list[Array]:
    """Return the log densities (samples,) of each held-out fold, with the noise level that *plain* shows there.

    The noise of a part may be far larger than that of the other runs (a gust, a glitch, a rougher run). Its noise level
    is then raised for every candidate. Otherwise a few samples would outweigh all others, in either direction.
    """
    densities = []
    for fit, base in zip(fits, plain, strict=True):
        rougher = 1.0 if base is None or base.roughness < FAR_ROUGHER else base.roughness
        densities.append(np.full(1, RUNS_AWAY) if fit is None else fit.densities(rougher))
    return densities


def interval_of(before: Sequence[Array], after: Sequence[Array]) -> tuple[float, float]:
    """Return the 90 % interval of the held-out log-likelihood gain: the narrower of two intervals.

    The first follows from the scatter over blocks, because a single gust or manoeuvre may cause the whole gain. The
    second follows from the scatter over held-out folds. A refitted noise level shifts gain from lively blocks to quiet
    ones, in all runs alike, which widens the first interval only.
    """
    size = max(FEWEST, sum(map(len, before)) // BLOCKS)
    wholes, sums = [], []
    for old, new in zip(before, after, strict=True):
        d = new - old
        wholes.append(float(np.sum(d)))
        sums += [float(np.sum(part)) for part in np.array_split(d, max(1, len(d) // size))]
    half = _half_width(sums)
    if len(wholes) >= FEWEST_WHOLES:
        half = min(half, _half_width(wholes))
    return sum(wholes) - half, sum(wholes) + half


def _half_width(parts: Sequence[float]) -> float:
    """Return half the 90 % interval of the sum of *parts*, from their scatter by Student's distribution."""
    n = len(parts)
    return float(stdtrit(n - 1, SURE)) * math.sqrt(n * float(np.var(parts, ddof=1))) if n > 1 else math.inf


SEED, DRAWS = 0, 400
"""Seed and number of resamples for the bootstrap interval of an error ratio."""


def gains_ahead(
    problem: NoisyProblem, plain: NoisyFit, folds: Folds, before: Unseen, after: Unseen, words: str
) -> Iterator[tuple[float, ErrorReduction]]:
    """Yield (horizon [s], held-out error at that horizon before and after) for each of :func:`.horizons`.

    plain : the model without any cause, which determines the horizons. words : description of what is left out.

    A model that diverges has an infinite error. If *before* diverges, no result is yielded for that horizon.
    """
    signal = next(iter(problem.segments[0].signals))
    for seconds in horizons(problem, plain):
        squares: list[Array] = []
        each: dict[str, tuple[float, float]] = {}
        for (train, test), *fits in zip(folds, before, after, strict=True):
            seen = problem.on(test)
            errors = [np.array([math.inf]) if fit is None else seen.ahead(fit, seconds) for fit in fits]
            good = min(len(e) for e in errors)
            squares.append(np.array([e[:good] ** 2 for e in errors]))
            left_out = {s.run for s in test}
            if len(left_out) == 1 and good and not left_out & {s.run for s in train}:
                each[left_out.pop()] = (float(np.sqrt(squares[-1][0].mean())), float(np.sqrt(squares[-1][1].mean())))
        joined = np.hstack(squares)
        if joined.shape[1] < 2 or not np.all(np.isfinite(joined[0])) or not np.any(joined[0] > 0.0):
            continue
        old, new = np.sqrt(joined.mean(axis=1)).tolist()
        known = bool(np.all(np.isfinite(joined[1])))
        ratio, interval = (new / old, _ratio_interval(squares)) if known else (math.inf, (math.inf, math.inf))
        metric, unit = f"error {seconds:g} s ahead", SIGNALS[signal][0]
        yield seconds, ErrorReduction(metric, signal, unit, old, new, ratio, interval, words, each)


def _ratio_interval(squares: Sequence[Array]) -> tuple[float, float]:
    """Return the 95 % interval of the ratio of rms errors.

    squares : for each part, the squared errors (2, k) of both models.
    """
    draws = np.random.default_rng(SEED)
    squares = [part for part in squares if part.size]  # a part may be shorter than the horizon
    ratios = []
    for _ in range(DRAWS):
        chosen = [squares[i] for i in draws.integers(0, len(squares), len(squares))]
        drawn = np.hstack(chosen)
        drawn = drawn[:, draws.integers(0, drawn.shape[1], drawn.shape[1])]
        ratios.append(float(np.sqrt(drawn[1].mean() / max(drawn[0].mean(), 1e-300))))
    low, high = np.quantile(ratios, [0.025, 0.975])
    return float(low), float(high)
