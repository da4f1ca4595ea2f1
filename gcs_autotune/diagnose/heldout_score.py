"""What a cause gains on data left out, with process noise modelled: log-likelihood, and error some seconds ahead."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from gcs_autotune.diagnose.heldout import BLOCKS, FEWEST
from gcs_autotune.diagnose.result import ErrorReduction
from gcs_autotune.diagnose.sampling_interval import horizons, prediction_horizon, refitted
from gcs_autotune.identify import NoisyFit, NoisyProblem, Segment
from gcs_autotune.sname import SIGNALS

__all__ = ["Folds", "densities_of", "gains_ahead", "interval_of", "unseen_of"]

Array = NDArray[np.float64]

Folds = tuple[tuple[tuple[Segment, ...], tuple[Segment, ...]], ...]
"""What is left out in turn: segments to fit, segments to predict."""

Unseen = Sequence[NoisyFit | None]
"""A model refitted to the rest of each fold, as it is on what that leaves out; None where it runs away."""

REFIT = 4
"""Scoring rounds of a fit to the rest when a run is left out."""

RUNS_AWAY = -1e6
"""Log density of a sample on which a model runs away."""

FAR_ROUGHER = 2.0
"""Chosen: squares of innovations on data left out, over what the other runs' fit expects, from which on its weather is
another's."""

FEWEST_WHOLES = 4
"""Chosen: parts left out, of which the scatter tells something: two or three are alike by accident."""

SURE = 0.95
"""Quantile at either end of a 90 % interval: a gain is none in one case of twenty."""


def unseen_of(problem: NoisyProblem, plain: NoisyFit, folds: Folds, fit: NoisyFit) -> Unseen:
    """Return *fit*, refitted to the rest of each fold, as it is on what that leaves out.

    plain : the model without any cause, by which it is chosen how far ahead refits are compared.
    """
    seconds, found = prediction_horizon(problem, plain), []
    for train, test in folds:
        again = refitted(problem.on(train), fit, REFIT, seconds)
        found.append(None if again is None else problem.on(test).judge(again))
    return found


def densities_of(fits: Unseen, plain: Unseen) -> list[Array]:
    """Return the log densities (samples,) of what each fold leaves out, under the weather that *plain* shows there.

    Where that is far rougher than the other runs' (a gust, a glitch, a worse day), it is so for every candidate:
    by the others' calm, a few samples would outweigh all there is, to either side.
    """
    found = []
    for fit, base in zip(fits, plain, strict=True):
        rougher = 1.0 if base is None or base.roughness < FAR_ROUGHER else base.roughness
        found.append(np.full(1, RUNS_AWAY) if fit is None else fit.densities(rougher))
    return found


def interval_of(before: Sequence[Array], after: Sequence[Array]) -> tuple[float, float]:
    """Return the 90 % interval of the log-likelihood gained on all that is left out: of two the narrower.

    From its scatter over blocks, for a single gust, or one manoeuvre, may bring all of a gain; and over what is left
    out in turn: a noise level fitted anew takes from lively blocks what it gives to quiet ones, in every run alike.
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
    """Return half the 90 % interval of the sum of *parts*, by Student's law of their scatter."""
    n = len(parts)
    return float(stdtrit(n - 1, SURE)) * math.sqrt(n * float(np.var(parts, ddof=1))) if n > 1 else math.inf


SEED, DRAWS = 0, 400
"""Of the interval of a ratio of errors, by drawing parts again with replacement."""


def gains_ahead(
    problem: NoisyProblem, plain: NoisyFit, folds: Folds, before: Unseen, after: Unseen, words: str
) -> Iterator[tuple[float, ErrorReduction]]:
    """Yield how far ahead [s], and the error there on data left out, before and after, for each of :func:`.horizons`.

    plain : the model without any cause, by which these are chosen. words : what is left out. A model that runs away
    has an infinite error; nothing is known where *before* does.
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
    """Return the 95 % interval of the ratio of rms errors, from the squares (2, k) of either model on each part."""
    draws = np.random.default_rng(SEED)
    ratios = []
    for _ in range(DRAWS):
        chosen = [squares[i] for i in draws.integers(0, len(squares), len(squares))]
        drawn = np.hstack(chosen)
        drawn = drawn[:, draws.integers(0, drawn.shape[1], drawn.shape[1])]
        ratios.append(float(np.sqrt(drawn[1].mean() / max(drawn[0].mean(), 1e-300))))
    low, high = np.quantile(ratios, [0.025, 0.975])
    return float(low), float(high)
