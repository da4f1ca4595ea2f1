"""Error on data left out: folds, the error of a model there, and whether another model's is truly smaller."""

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
from gcs_autotune.identify import Fitted, Problem, Residual, Segment
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
"""Parts left out in turn."""

BLOCKS = 24
"""Blocks the held-out errors are averaged over before they are compared: neighbours share their errors."""

FEWEST = 8
"""Fewest samples of a block."""


@dataclass(frozen=True, slots=True, eq=False)
class HeldOutFold:
    """Segments to fit, segments to predict."""

    train: tuple[Segment, ...]
    test: tuple[Segment, ...]


@dataclass(frozen=True, slots=True, eq=False)
class HeldOut:
    """Residuals of a model on data it has not seen, ``complete`` False when it ran away somewhere."""

    rests: tuple[Residual, ...]
    complete: bool


@dataclass(frozen=True, slots=True, eq=False)
class Parts:
    """What is left out in turn: folds, initial states of what each fits and tests, and in ``words`` what it is.

    ``kind``: runs ``"apart"`` from those fitted, whole ``"runs"`` left out, or ``"blocks"`` of them.
    """

    kind: Literal["apart", "runs", "blocks"]
    folds: tuple[HeldOutFold, ...]
    starts: tuple[tuple[Array, ...], ...]
    tests: tuple[tuple[Array, ...], ...]
    words: str

    def set_right(self, problem: Problem, fitted: Fitted) -> Parts:
        """Return them with every segment beginning where its signals say that *fitted* takes for spoilt, set right."""
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
    """Return what is left out of a problem's segments.

    With *unseen* runs these; with several runs each (or each group of runs) in turn; of the only run, or *in_blocks*
    of every run, a part in turn.
    """
    segments = problem.segments
    runs = list(dict.fromkeys(s.run for s in segments))
    if unseen:
        fold = HeldOutFold(tuple(segments), tuple(unseen))
        names = ", ".join(dict.fromkeys(s.run for s in unseen))
        return _begun(problem, "apart", [fold], f"runs not used for fitting: {names}")
    if len(runs) > 1 and in_blocks:
        pieces = [s.pieces(MOST_FOLDS) for s in segments]
        label = [k for own in pieces for k in range(len(own))]
        words = f"{max(label) + 1} blocks of every run left out in turn"
        return _begun(problem, "blocks", _labelled([p for own in pieces for p in own], label), words)
    if len(runs) > 1:
        count = min(len(runs), MOST_FOLDS)
        group = {run: i % count for i, run in enumerate(runs)}
        words = (
            f"each of {len(runs)} runs left out in turn" if count == len(runs) else f"{count} groups of runs in turn"
        )
        return _begun(problem, "runs", _labelled(segments, [group[s.run] for s in segments]), words)
    longest = max(range(len(segments)), key=lambda i: len(segments[i].stamps))
    blocks = segments[longest].pieces(MOST_FOLDS)
    pool = [*blocks, *(s for i, s in enumerate(segments) if i != longest)]
    folds = _labelled(pool, [i % len(blocks) for i in range(len(pool))])
    return _begun(problem, "blocks", folds, f"{len(blocks)} blocks of the run left out in turn")


def _labelled(pool: Sequence[Segment], label: Sequence[int]) -> list[HeldOutFold]:
    """Return a fold for every label, which is tested while the others are fitted."""
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
    """Predict what each fold leaves out by a model fitted to the rest of it.

    refit : the model is fitted anew on each fold, beginning at *fitted*; False: it is taken as it is.
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
    """Return the root mean square of what is left, per signal."""
    squares: dict[str, list[Array]] = {}
    for rest in rests:
        good = rest.judged[np.isfinite(rest.judged)]
        squares.setdefault(rest.signal, []).append(good**2)
    return {n: float(np.sqrt(np.mean(np.concatenate(s)))) if sum(map(len, s)) else math.nan for n, s in squares.items()}


def blocks(before: Sequence[Residual], after: Sequence[Residual]) -> tuple[list[tuple[str, float, float, int]], int]:
    """Return per block: signal, sum of squares before, after, and samples; cut alike for both."""
    total = sum(len(r.judged) for r in before)
    size = max(FEWEST, total // BLOCKS)
    found = []
    for old, new in zip(before, after, strict=True):
        count = max(1, len(old.judged) // size)
        for a, b in zip(np.array_split(old.judged, count), np.array_split(new.judged, count), strict=True):
            good = np.isfinite(a) & np.isfinite(b)
            sole = np.isfinite(a) & ~np.isfinite(b)
            if good.any():
                found.append(
                    (
                        old.signal,
                        float(np.sum(a[good] ** 2) + np.sum(a[sole] ** 2)),
                        float(np.sum(b[good] ** 2)),
                        int(good.sum()),
                    )
                )
    return found, size


def p_value(
    before: HeldOut, after: HeldOut, levels: Mapping[str, float], raised: float, numbers: int, tried: int
) -> float:
    """Return the chance that *after* only seems better on unseen data, times how many were *tried* (at most 1).

    The split likelihood ratio (Wasserman2020): the likelihood of data
    left out under a model fitted to the rest, with the noise *levels* found there, over the largest likelihood of the
    model before, is an e-value; over folds their mean is one, and its inverse is a p value whatever the sample size.
    The largest likelihood of the model before is that of its held-out error, with the *numbers* it would gain by being
    fitted there. *raised*: samples that make one independent one.
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
    """Return the 95 % interval of the ratio of rms errors, by drawing blocks with replacement."""
    rows, _ = blocks(before, after)
    a, b = np.array([r[1] for r in rows]), np.array([r[2] for r in rows])
    if len(a) < 3:
        return math.nan, math.nan
    draws = np.random.default_rng(seed).integers(0, len(a), (2000, len(a)))
    ratios = np.sqrt(b[draws].sum(axis=1) / np.maximum(a[draws].sum(axis=1), 1e-300))
    low, high = np.quantile(ratios, (0.025, 0.975))
    return float(low), float(high)


def gains_of(before: HeldOut, after: HeldOut, words: str) -> tuple[ErrorReduction, ...]:
    """Return the gain of every signal; *words* say what was left out. None where a model runs away."""
    old, new = rms_of(before.rests), rms_of(after.rests)
    found = []
    for name in old:
        if name not in new or not old[name] > 0.0 or not before.complete or not after.complete:
            continue
        pairs = [(a, b) for a, b in zip(before.rests, after.rests, strict=True) if a.signal == name]
        interval = ratio_interval([a for a, _ in pairs], [b for _, b in pairs])
        found.append(
            ErrorReduction(METRIC, name, SIGNALS[name][0], old[name], new[name], new[name] / old[name], interval, words)
        )
    return tuple(found)


def own_gain(before: HeldOut, after: HeldOut | None, words: str) -> ErrorReduction | None:
    """Return the gain on data left out of one cause, for the signal that surely gains most; None where unknown."""
    if after is None or len(before.rests) != len(after.rests):
        return None
    return surest(gains_of(before, after, words))


def surest(gains: Sequence[ErrorReduction]) -> ErrorReduction | None:
    """Return the gain with the smallest upper end of its interval."""
    return min(gains, key=lambda g: g.ratio if math.isnan(g.ci95[1]) else g.ci95[1], default=None)
