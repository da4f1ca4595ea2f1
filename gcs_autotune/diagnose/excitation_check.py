"""Whether runs can tell causes apart: enough samples, commands that change, motion coherent with them."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.errors import NotInformative
from gcs_autotune.identify import INPUTS, THRUSTERS, signals_of
from gcs_autotune.models import Form
from gcs_autotune.slow_imports import scipy_signal
from gcs_autotune.sname import DOFS
from gcs_autotune.trial import Channel, Trial

__all__ = ["COMMANDS", "FEWEST", "MOTIONS", "check_alive", "check_excitation", "coherence", "held_share", "on_grid"]

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
            f"no input ({', '.join(inputs)}) ever changes{still}: without commands, errors of a simulation cannot be "
            "distinguished from a wrong initial state; fly steps both ways, a zig-zag or a relay"
        )
    if inputs and motions and not _vary(runs, motions):
        raise NotInformative(
            f"no motion: {', '.join(motions)} never change; check that the logger is connected to the sensors"
        )


def _vary(runs: Sequence[Trial], names: Sequence[str]) -> bool:
    return any(np.ptp(run[n].values) > 0.0 for run in runs for n in names if n in run and len(run[n]))


def check_excitation(runs: Sequence[Trial], form: Form, signals: Sequence[str] | None = None) -> None:
    """Refuse *runs* that hold too little to diagnose *form* with; *signals*: those to compare, all when None.

    Raises
    ------
    NotInformative
        Too few samples; inputs that never change, or once; motion that is unrelated to the inputs.
    """
    there = [n for n in (signals or signals_of(form)) if any(n in run for run in runs)]
    samples = max((sum(len(run[n]) for run in runs if n in run) for n in there), default=0)
    if samples < FEWEST:
        raise NotInformative(
            f"{samples} samples are too few to distinguish causes: {FEWEST} are needed, 500 are better; fly longer or "
            "log faster"
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
            f"the inputs ({', '.join(names)}) change only once: after a single step every cause looks like a different "
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
                best = max(best, coherence(y, u), coherence(y, u, integrated=True))
    if samples and best < max(ANSWER, 10.0 / samples):
        raise NotInformative(
            f"the motion ({', '.join(signals)}) does not follow the inputs ({', '.join(form.inputs)}): they "
            f"account for {100 * best:.0f} % of it; check that all columns are of one craft and one clock"
        )


GRID = 2000
"""Samples of the common grid, at most."""

LAGS = np.geomspace(0.3, 300.0, 13)
"""Time constants tried, in steps of the grid."""


def on_grid(*channels: Channel) -> tuple[float, list[Array]] | None:
    """Return a common step [s] and all channels held on it where they overlap; None when they hardly do."""
    if any(len(c) < 2 for c in channels):
        return None
    start, end = max(float(c.t[0]) for c in channels), min(float(c.t[-1]) for c in channels)
    step = max(min(float(np.median(np.diff(c.t))) for c in channels), (end - start) / GRID)
    if not (end > start and step > 0.0) or (end - start) / step < 3 * len(LAGS):
        return None
    t = np.arange(start, end, step)
    return step, [c.values[np.searchsorted(c.t, t, side="right") - 1] for c in channels]


def coherence(follower: Array, leader: Array, *, integrated: bool = False) -> float:
    """Return the share of *follower*'s variance (n,) that the best first-order lag of *leader* (n,) accounts for.

    Gain, offset and initial state are free, and what these account for without the leader does not count;
    *integrated*: the follower is the integral of such a lag (a position).
    """
    best = 0.0
    n = len(follower)
    index = np.arange(n)
    for lag in LAGS:
        a = math.exp(-1.0 / lag)
        lagged = scipy_signal().lfilter([0.0, 1.0 - a], [1.0, -a], leader)
        own = [np.ones(n), a**index, index / n] if integrated else [np.ones(n), a**index]
        without = _left(np.column_stack(own), follower)
        if without > 1e-18 * float(follower @ follower):
            left = _left(np.column_stack([*own, np.cumsum(lagged) if integrated else lagged]), follower)
            best = max(best, 1.0 - left / without)
    return best


def _left(table: Array, y: Array) -> float:
    """Return the sum of squares of *y* (n,) that the columns of *table* (n, k) leave."""
    norms = np.linalg.norm(table, axis=0)
    Q, R = np.linalg.qr(table[:, norms > 0.0] / norms[norms > 0.0])
    Q = Q[:, np.abs(np.diag(R)) > 1e-9]
    left = y - Q @ (Q.T @ y)
    return float(left @ left)


def held_share(values: Array) -> float:
    """Return the share of samples (n,) that repeat the one before exactly, as a command between its changes does."""
    return float(np.mean(np.diff(values) == 0.0)) if len(values) > 1 else 0.0
