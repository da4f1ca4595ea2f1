"""Does the past of a command show in what is left? Forces with a memory that no entry of the book has.

Two kinds, each a bend of the command that the model may take on top of everything fitted: the command of a while ago
(a linear system of higher order than the model), and the command by the way it came (up or down). What a small amount
of it would do to the motion is a difference of two simulations.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.effects.effect import Leftover
from gcs_autotune.effects.extended import ExtendedSimulator, Passage
from gcs_autotune.identify.extended.fitting import Fitted, Problem, judged_by

__all__ = ["memories"]

Array = NDArray[np.float64]
Bend = Callable[[Array, Array], Array]

LAGS = (1, 2, 4, 8, 16)
"""How long ago, in samples of the run."""

STEP = 1e-3
"""Share of the command that is bent, for difference quotients."""


def memories(problem: Problem, fitted: Fitted) -> Iterator[tuple[str, Array]]:
    """Yield, in words, a way to remember, and what it would do to the residual: columns (n, k)."""
    sample = float(np.median([np.median(np.diff(s.passage.stamps)) for s in problem.stretches]))
    for channel, pairs in fitted.form.inputs.items():
        if not pairs:
            continue
        past = [_column(problem, fitted, channel, _ago(lag * sample)) for lag in LAGS]
        if all(c is not None for c in past):
            yield f"the past of {channel}", np.column_stack([c for c in past if c is not None])
        came = _column(problem, fitted, channel, lambda t, told: told * _direction(told))
        if came is not None:
            yield f"which way {channel} came", came[:, None]


def _column(problem: Problem, fitted: Fitted, channel: str, bend: Bend) -> Array | None:
    """Return (n,) what a trace of the bent command does to the residual, over the noise levels; None if it cannot."""
    simulator = ExtendedSimulator(fitted.form, fitted.effects)
    parts, at = [], 0
    for i, stretch in enumerate(problem.stretches):
        passage = stretch.late(fitted.shift)
        moved = simulator.run(fitted.theta, fitted.effects, fitted.initial[i], _bent(passage, channel, bend))
        plain = simulator.run(fitted.theta, fitted.effects, fitted.initial[i], passage)
        if moved is None or plain is None:
            return None
        for name in stretch.record.signals:
            rest, level = fitted.rests[at], fitted.levels[name]
            at += 1
            left = Leftover(stretch.run, name, rest.t, rest.measured - rest.predicted, rest.measured, level)
            change = (moved[name][0] - plain[name][0])[:, None] / STEP
            _, columns, _ = judged_by(fitted.effects, left, change)
            parts.append(columns[np.isfinite(rest.judged), 0] / level)
    return np.concatenate(parts)


def _bent(passage: Passage, channel: str, bend: Bend) -> Passage:
    told = passage.commands[channel]
    return replace(passage, commands={**passage.commands, channel: told + STEP * bend(passage.t_in, told)})


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
