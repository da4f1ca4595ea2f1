"""Does the past of a command show in what is left? Forces with a memory that no entry of the book has.

Two kinds, each a bend of the command that the model may take on top of everything fitted: the command of a while ago
(a linear system of higher order than the model), and the command by the way it came (up or down). What a small amount
of it would do to the motion is a difference of two simulations.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.effects import ExtendedSimulator, Leftover, Passage
from gcs_autotune.identify.extended.fitting import Fitted, Problem, judged_by

__all__ = ["Bend", "bent_by", "dense", "memories"]

Array = NDArray[np.float64]
Bend = Callable[[Array, Array], Array]

LAGS = (1, 2, 4, 8, 16)
"""How long ago, in samples of the run."""

STEP = 1e-3
"""Share of the command that is bent, for difference quotients."""


def memories(problem: Problem, fitted: Fitted) -> Iterator[tuple[str, Array]]:
    """Yield, in words, a way to remember, and what it would do to the residual: columns (n, k)."""
    sample = float(np.median([np.median(np.diff(s.passage.stamps)) for s in problem.segments]))
    for channel, pairs in fitted.form.inputs.items():
        if not pairs:
            continue
        ways: list[Bend] = [*(_ago(lag * sample) for lag in LAGS), lambda t, told: told * _direction(told)]
        columns = bent_by(problem, fitted, channel, ways)
        if columns is not None:
            yield f"the past of {channel}", columns[:, :-1]
            yield f"which way {channel} came", columns[:, -1:]


def bent_by(problem: Problem, fitted: Fitted, channel: str, bends: Sequence[Bend]) -> Array | None:
    """Return (n, k) what a trace of each bend of the command does to the residual, over the noise levels.

    None when the motion runs away.
    """
    simulator = ExtendedSimulator(fitted.form, fitted.effects)
    rows, at = [], 0
    for i, segment in enumerate(problem.segments):
        passage = dense(segment.passage_at(fitted.shift))
        told = passage.commands[channel]
        ways = [told, *(told + STEP * bend(passage.t_in, told) for bend in bends)]
        flown = [replace(passage, commands={**passage.commands, channel: way}) for way in ways]
        found = [simulator.run(fitted.theta, fitted.effects, fitted.initial[i], way) for way in flown]
        moved = [f for f in found if f is not None]
        if len(moved) < len(found):
            return None
        for name in segment.signals:
            rest, level = fitted.rests[at], fitted.levels[name]
            at += 1
            left = Leftover(segment.run, name, rest.t, rest.measured - rest.predicted, rest.measured, level)
            change = np.column_stack([f[name][0] - moved[0][name][0] for f in moved[1:]]) / STEP
            _, columns, _ = judged_by(fitted.effects, left, change)
            rows.append(columns[np.isfinite(rest.judged)] / level)
    return np.vstack(rows)


def dense(passage: Passage) -> Passage:
    """Return the passage with its inputs told at every sample, not only where they change: a bend changes all along."""
    t = np.union1d(passage.t_in, passage.stamps)
    at = np.maximum(np.searchsorted(passage.t_in, t, side="right") - 1, 0)
    return replace(passage, t_in=t, commands={name: told[at] for name, told in passage.commands.items()})


def _ago(seconds: float) -> Bend:
    def bend(t: Array, told: Array) -> Array:
        return told[np.maximum(np.searchsorted(t, t - seconds, side="right") - 1, 0)] if len(t) else told

    return bend


def _direction(told: Array) -> Array:
    """Return (j,) +1 where the command last grew, -1 where it last shrank; +1 before any change."""
    change = np.sign(np.diff(told, prepend=told[:1]))
    last = np.maximum.accumulate(np.where(change != 0.0, np.arange(len(told)), 0))
    found = change[last]
    return np.where(found == 0.0, 1.0, found)
