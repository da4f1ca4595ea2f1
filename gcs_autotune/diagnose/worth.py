"""Whether runs can tell causes apart at all: enough samples, commands that change, motion that answers."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.diagnose.follows import follows, on_grid
from gcs_autotune.errors import NotInformative
from gcs_autotune.identify.base_model import THRUSTERS
from gcs_autotune.identify.preparation import INPUTS, signals_of
from gcs_autotune.models.coupled import Form
from gcs_autotune.sname import DOFS
from gcs_autotune.trial import Channel, Trial

__all__ = ["FEWEST", "check_alive", "check_worth"]

Array = NDArray[np.float64]

COMMANDS = frozenset(n for names in INPUTS.values() for n in names) | set(THRUSTERS)

MOTIONS = frozenset(n for d in DOFS.values() for n in (d.velocity, d.position))

FEWEST = 50
"""Chosen: samples of all runs together below which no cause is told from another (twelve per block left out)."""

BINS, DWELL, MOVE = 10, 0.03, 0.2
"""A level of an input: one of so many bins it spends this share of time in; a move changes it by ``MOVE`` of all."""

ANSWER = 0.02
"""Chosen: least share of a signal's variance that some input accounts for; noise alone reaches about 10 / samples."""


def check_alive(runs: Sequence[Trial]) -> None:
    """Refuse *runs* in which nothing is commanded, or nothing moves.

    Raises
    ------
    NotInformative
        Saying which columns stand still.
    """
    inputs = sorted({n for run in runs for n in run.channels if n in COMMANDS})
    motions = sorted({n for run in runs for n in run.channels if n in MOTIONS})
    if inputs and not _vary(runs, inputs):
        still = "" if _vary(runs, motions) or not motions else f", nor does any motion ({', '.join(motions)})"
        raise NotInformative(
            f"no input ({', '.join(inputs)}) ever changes{still}: without commands a simulation's errors cannot be "
            "told from its initial state; fly steps both ways, a zig-zag or a relay"
        )
    if inputs and motions and not _vary(runs, motions):
        raise NotInformative(
            f"nothing moves: {', '.join(motions)} never change; is the logger connected to the sensors?"
        )


def _vary(runs: Sequence[Trial], names: Sequence[str]) -> bool:
    return any(np.ptp(run[n].values) > 0.0 for run in runs for n in names if n in run and len(run[n]))


def check_worth(runs: Sequence[Trial], form: Form, signals: Sequence[str] | None = None) -> None:
    """Refuse *runs* that hold too little to diagnose *form* with; *signals*: those to compare, all when None.

    Raises
    ------
    NotInformative
        Too few samples; inputs that never change, or once; motion that has nothing to do with the inputs.
    """
    there = [n for n in (signals or signals_of(form)) if any(n in run for run in runs)]
    samples = max((sum(len(run[n]) for run in runs if n in run) for n in there), default=0)
    if samples < FEWEST:
        raise NotInformative(
            f"{samples} samples in all are too few to tell one cause from another: at least {FEWEST}, better 500; "
            "fly longer or log faster"
        )
    _check_commands(runs, form)
    _check_answer(runs, form, there)


def _check_commands(runs: Sequence[Trial], form: Form) -> None:
    names = [n for n in form.inputs if any(n in run and len(run[n]) for run in runs)]
    if not names:
        return
    changes = {n: _changes([run[n] for run in runs if n in run and len(run[n])]) for n in names}
    moves = max(m for m, _ in changes.values())
    levels = max(n for _, n in changes.values())
    if moves < 2 and levels < 3:
        raise NotInformative(
            f"the inputs ({', '.join(names)}) change once only: after a single step every cause looks like another "
            "inertia or drag; fly steps of several sizes both ways, a zig-zag or a relay"
        )


def _changes(channels: Sequence[Channel]) -> tuple[int, int]:
    """Return how often an input moves by a good part of its range, and at how many levels it dwells, in all runs."""
    low = min(float(c.values.min()) for c in channels)
    swing = max(float(c.values.max()) for c in channels) - low
    if not swing > 0.0:
        return 0, 1
    moves = 0
    spent = np.zeros(BINS)
    for c in channels:
        share = (c.values - low) / swing
        at = np.minimum((BINS * share).astype(int), BINS - 1)
        spent += np.bincount(at, minlength=BINS)
        moves += _moves(share)
    return moves, int(np.sum(spent > DWELL * spent.sum()))


def _moves(share: Array) -> int:
    """Return how many times a record (n,) in 0..1 goes up or down by more than ``MOVE`` before it turns."""
    extreme, direction, count = float(share[0]), 0, 0
    for value in share.tolist():
        beyond = value - extreme
        if (direction == 0 and abs(beyond) > MOVE) or (direction and -direction * beyond > MOVE):
            direction, count, extreme = (1 if beyond > 0.0 else -1), count + 1, value
        elif direction * beyond > 0.0:
            extreme = value
    return count


def _check_answer(runs: Sequence[Trial], form: Form, signals: Sequence[str]) -> None:
    best, samples = 0.0, 0
    for run in runs:
        for name in (n for n in form.inputs if n in run):
            for signal in (s for s in signals if s in run):
                grid = on_grid(run[name], run[signal])
                if grid is None:
                    return
                u, y = grid[1]
                samples = max(samples, len(y))
                best = max(best, follows(y, u), follows(y, u, integrated=True))
    if samples and best < max(ANSWER, 10.0 / samples):
        raise NotInformative(
            f"the motion ({', '.join(signals)}) has nothing to do with the inputs ({', '.join(form.inputs)}): they "
            f"account for {100 * best:.0f} % of it; are the columns of one craft and one clock?"
        )
