"""Calculate errors on held-out data, and test whether another model's error is really smaller."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from gcs_autotune.diagnose.result import ErrorReduction
from gcs_autotune.diagnose.undo_data_errors import undo_data_errors
from gcs_autotune.identify.problems import Fitted, Problem, Residual
from gcs_autotune.identify.signals import Segment
from gcs_autotune.sname import SIGNALS

__all__ = [
    "METRIC",
    "HeldOut",
    "HeldOutFold",
    "Parts",
    "blocks",
    "gains_of",
    "held_out",
    "own_gain",
    "p_value",
    "parts_of",
    "ratio_interval",
    "rms_of",
    "surest",
]

Array = NDArray[np.float64]


METRIC = "held-out simulation RMSE"

MOST_FOLDS = 4
"""Maximum number of folds."""

BLOCKS = 24
"""Number of blocks that held-out errors are averaged over before comparison, because neighbouring errors correlate."""

FEWEST = 8
"""Minimum number of samples of a block."""


@dataclass(frozen=True, slots=True, eq=False)
class HeldOutFold:
    """One fold: segments to which models are fitted (``train``), and segments that they predict (``test``)."""

    train: tuple[Segment, ...]
    test: tuple[Segment, ...]


@dataclass(frozen=True, slots=True, eq=False)
class HeldOut:
    """Residuals of a model on held-out data; ``complete`` is False if the motion diverged on a segment."""

    rests: tuple[Residual, ...]
    complete: bool


@dataclass(frozen=True, slots=True, eq=False)
class Parts:
    """The folds held out in turn.

    ``kind``: ``"apart"`` for separate runs, ``"runs"`` for whole runs left out, ``"blocks"`` for blocks of runs.
    ``starts`` and ``tests``: initial states of the fitted and of the tested segments. ``words``: a description.
    """

    kind: Literal["apart", "runs", "blocks"]
    folds: tuple[HeldOutFold, ...]
    starts: tuple[tuple[Array, ...], ...]
    tests: tuple[tuple[Array, ...], ...]
    words: str

    def set_right(self, problem: Problem, fitted: Fitted) -> Parts:
        """Return the folds with new initial states, from data corrected for the data errors that *fitted* contains."""
        segments = {id(s): s for fold in self.folds for s in (*fold.train, *fold.test)}
        right = {at: undo_data_errors(fitted.effects, s) for at, s in segments.items()}
        if all(right[at] is s for at, s in segments.items()):
            return self
        states = dict(zip(right, problem.first_states(list(right.values())), strict=True))
        return replace(
            self,
            starts=tuple(tuple(states[id(s)] for s in fold.train) for fold in self.folds),
            tests=tuple(tuple(states[id(s)] for s in fold.test) for fold in self.folds),
        )


def parts_of(problem: Problem, unseen: Sequence[Segment] = (), *, in_blocks: bool = False) -> Parts:
    """Return the segments of a problem, divided into folds that are held out in turn.

    These are the *unseen* runs if there are any. With several runs, each run (or group of runs) is left out in turn.
    With one run, or *in_blocks*, blocks of every run are left out.
    """
    segments = problem.segments
    runs = list(dict.fromkeys(s.run for s in segments))
    if unseen:
        fold = HeldOutFold(tuple(segments), tuple(unseen))
        names = ", ".join(dict.fromkeys(s.run for s in unseen))
        return _begun(problem, "apart", [fold], f"held-out runs: {names}")
    if len(runs) > 1 and in_blocks:
        pieces = [s.pieces(MOST_FOLDS) for s in segments]
        label = [k for own in pieces for k in range(len(own))]
        words = f"{max(label) + 1} blocks of every run held out in turn"
        return _begun(problem, "blocks", _labelled([p for own in pieces for p in own], label), words)
    if len(runs) > 1:
        count = min(len(runs), MOST_FOLDS)
        group = {run: i % count for i, run in enumerate(runs)}
        words = (
            f"each of {len(runs)} runs held out in turn"
            if count == len(runs)
            else f"{count} groups of runs held out in turn"
        )
        return _begun(problem, "runs", _labelled(segments, [group[s.run] for s in segments]), words)
    longest = max(range(len(segments)), key=lambda i: len(segments[i].stamps))
    blocks = segments[longest].pieces(MOST_FOLDS)
    pool = [*blocks, *(s for i, s in enumerate(segments) if i != longest)]
    folds = _labelled(pool, [i % len(blocks) for i in range(len(pool))])
    return _begun(problem, "blocks", folds, f"{len(blocks)} blocks of the run held out in turn")


def _labelled(pool: Sequence[Segment], label: Sequence[int]) -> list[HeldOutFold]:
    """Return one fold for each label: its segments are tested while the others are fitted."""
    folds = []
    for k in range(max(label) + 1):
        train = tuple(s for s, own in zip(pool, label, strict=True) if own != k)
        test = tuple(s for s, own in zip(pool, label, strict=True) if own == k)
        if train and test:
            folds.append(HeldOutFold(train, test))
    return folds


def _begun(
    problem: Problem, kind: Literal["apart", "runs", "blocks"], folds: Sequence[HeldOutFold], words: str
) -> Parts:
    segments = list({id(s): s for fold in folds for s in (*fold.train, *fold.test)}.values())
    states = {id(s): x for s, x in zip(segments, problem.first_states(segments), strict=True)}
    starts = tuple(tuple(states[id(s)] for s in fold.train) for fold in folds)
    tests = tuple(tuple(states[id(s)] for s in fold.test) for fold in folds)
    return Parts(kind, tuple(folds), starts, tests, words)


def held_out(problem: Problem, parts: Parts, fitted: Fitted, *, refit: bool) -> HeldOut:
    """Return the residuals of predictions of each held-out fold with a model fitted to the rest.

    refit : whether the model is fitted again on each fold, starting from *fitted*. False: it is used unchanged.
    """
    rests: list[Residual] = []
    complete = True
    parts = parts.set_right(problem, fitted)
    for k, (fold, initial, states) in enumerate(zip(parts.folds, parts.starts, parts.tests, strict=True)):
        theta, effects, shift = fitted.theta, fitted.effects, fitted.shift
        if refit:
            again = problem.on(fold.train).fit(theta, effects, initial, trials=8, shift=shift)
            if again is None:
                complete = False
                continue
            theta, effects, shift = again.theta, again.effects, again.shift
        predicted = problem.on(fold.test).states(theta, effects, states, shift)
        if predicted is None:
            complete = False
            continue
        rests += [replace(r, fold=k) for r in predicted.rests]
    return HeldOut(tuple(rests), complete)


def rms_of(rests: Sequence[Residual]) -> dict[str, float]:
    """Return signal -> root mean square of its residuals."""
    squares: dict[str, list[Array]] = {}
    for rest in rests:
        good = rest.judged[np.isfinite(rest.judged)]
        squares.setdefault(rest.signal, []).append(good**2)
    return {n: float(np.sqrt(np.mean(np.concatenate(s)))) if sum(map(len, s)) else math.nan for n, s in squares.items()}


def blocks(before: Sequence[Residual], after: Sequence[Residual]) -> tuple[list[tuple[str, float, float, int]], int]:
    """Return for each block its signal, its sums of squares before and after, and its number of samples.

    Also return the block size. Both models use the same blocks.
    """
    total = sum(len(r.judged) for r in before)
    size = max(FEWEST, total // BLOCKS)
    folds = []
    for old, new in zip(before, after, strict=True):
        count = max(1, len(old.judged) // size)
        for a, b in zip(np.array_split(old.judged, count), np.array_split(new.judged, count), strict=True):
            good = np.isfinite(a) & np.isfinite(b)
            sole = np.isfinite(a) & ~np.isfinite(b)
            if good.any():
                folds.append(
                    (
                        old.signal,
                        float(np.sum(a[good] ** 2) + np.sum(a[sole] ** 2)),
                        float(np.sum(b[good] ** 2)),
                        int(good.sum()),
                    )
                )
    return folds, size


def p_value(
    before: HeldOut, after: HeldOut, levels: Mapping[str, float], raised: float, numbers: int, tried: int
) -> float:
    """Return the p-value that *after* only seems better on held-out data, multiplied by the number *tried* (at most 1).

    The method is the split likelihood ratio (Wasserman2020). The numerator is the likelihood of held-out data under a
    model fitted to the rest, with the noise *levels* of that fit. The denominator is the largest likelihood of the
    model before. The ratio is an e-value. Over folds the mean is an e-value too, and its inverse is a p-value for any
    sample size.

    The largest likelihood of the model before follows from its held-out error. The gain of its *numbers*, if they were
    fitted to the held-out data, is added.

    raised : number of correlated samples that count as one independent sample.
    """
    if not after.complete or len(before.rests) != len(after.rests):
        return 1.0
    logs = []
    for fold in range(max((r.fold for r in before.rests), default=-1) + 1):
        gained = -float(numbers)
        for name, level in levels.items():
            pairs = [
                (a, b) for a, b in zip(before.rests, after.rests, strict=True) if a.fold == fold and a.signal == name
            ]
            if not pairs:
                continue
            old, new = (np.concatenate([p[k].judged for p in pairs]) for k in (0, 1))
            old, new = old[np.isfinite(old)], new[np.isfinite(new)]
            if len(old) and len(new):
                own = max(float(np.mean(old**2)), 1e-300)
                gained += 0.5 * len(old) * (math.log(own) + 1.0)
                gained -= 0.5 * len(new) * (math.log(level**2) + float(np.mean(new**2)) / level**2)
                gained += 0.5 * sum(a.penalty - b.penalty for a, b in pairs)
        logs.append(gained / raised)
    if not logs:
        return 1.0
    e = float(logsumexp(logs)) - math.log(len(logs))
    return float(min(1.0, tried * math.exp(-float(np.clip(e, 0.0, 700.0)))))


def ratio_interval(before: Sequence[Residual], after: Sequence[Residual], seed: int = 0) -> tuple[float, float]:
    """Return the 95 % interval of the ratio of rms errors, by bootstrap over blocks."""
    rows, _ = blocks(before, after)
    a, b = np.array([r[1] for r in rows]), np.array([r[2] for r in rows])
    if len(a) < 3:
        return math.nan, math.nan
    draws = np.random.default_rng(seed).integers(0, len(a), (2000, len(a)))
    ratios = np.sqrt(b[draws].sum(axis=1) / np.maximum(a[draws].sum(axis=1), 1e-300))
    low, high = np.quantile(ratios, (0.025, 0.975))
    return float(low), float(high)


def gains_of(before: HeldOut, after: HeldOut, words: str) -> tuple[ErrorReduction, ...]:
    """Return the reduction of the held-out error of every signal; empty if a model diverges.

    words : description of what was left out.
    """
    old, new = rms_of(before.rests), rms_of(after.rests)
    reductions = []
    for name in old:
        if name not in new or not old[name] > 0.0 or not before.complete or not after.complete:
            continue
        pairs = [(a, b) for a, b in zip(before.rests, after.rests, strict=True) if a.signal == name]
        interval = ratio_interval([a for a, _ in pairs], [b for _, b in pairs])
        reductions.append(
            ErrorReduction(METRIC, name, SIGNALS[name][0], old[name], new[name], new[name] / old[name], interval, words)
        )
    return tuple(reductions)


def own_gain(before: HeldOut, after: HeldOut | None, words: str) -> ErrorReduction | None:
    """Return the reduction of the held-out error by one cause, for its most significant signal; None if unknown."""
    if after is None or len(before.rests) != len(after.rests):
        return None
    return surest(gains_of(before, after, words))


def surest(gains: Sequence[ErrorReduction]) -> ErrorReduction | None:
    """Return the error reduction whose interval has the smallest upper limit."""
    return min(gains, key=lambda g: g.ratio if math.isnan(g.ci95[1]) else g.ci95[1], default=None)
