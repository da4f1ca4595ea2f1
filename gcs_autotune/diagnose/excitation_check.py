"""Check whether runs can distinguish causes.

They need enough samples, commands that change, and motion that is coherent with the commands.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.errors import NotInformative
from gcs_autotune.identify.problems import THRUSTERS
from gcs_autotune.identify.signals import INPUTS, signals_of
from gcs_autotune.models import Form
from gcs_autotune.slow_imports import scipy_signal
from gcs_autotune.sname import DOFS
from gcs_autotune.trial import Channel, Trial

__all__ = ["COMMANDS", "FEWEST", "MOTIONS", "check_alive", "check_excitation", "coherence", "held_share", "on_grid"]

Array = NDArray[np.float64]


COMMANDS = frozenset(n for names in INPUTS.values() for n in names) | set(THRUSTERS)

MOTIONS = frozenset(n for d in DOFS.values() for n in (d.velocity, d.position))

FEWEST = 50
"""Minimum number of samples of all runs together: twelve per left-out block."""

BINS, DWELL, MOVE = 10, 0.03, 0.2
"""Constants for the levels of an input.

A level is one of BINS bins in which the input spends at least the fraction DWELL of the time. A move changes the input
by at least the fraction MOVE of its range.
"""

ANSWER = 0.02
"""Least fraction of a signal's variance that an input must explain. Noise alone reaches about 10 / samples."""


def check_alive(runs: Sequence[Trial]) -> None:
    """Reject *runs* in which nothing is commanded or nothing moves.

    Raises
    ------
    NotInformative
        The message lists the columns that do not change.
    """
    inputs = sorted({n for run in runs for n in run.channels if n in COMMANDS})
    motions = sorted({n for run in runs for n in run.channels if n in MOTIONS})
    if inputs and not _vary(runs, inputs):
        still = "" if _vary(runs, motions) or not motions else f", nor does any motion ({', '.join(motions)})"
        raise NotInformative(
            f"no input ({', '.join(inputs)}) ever changes{still}. Without commands the errors of a simulation look "
            "like a wrong initial state. Fly steps both ways, a zig-zag or a relay"
        )
    if inputs and motions and not _vary(runs, motions):
        raise NotInformative(
            f"the runs contain no motion: {', '.join(motions)} never change. Check that the logger is connected to the "
            "sensors"
        )


def _vary(runs: Sequence[Trial], names: Sequence[str]) -> bool:
    return any(np.ptp(run[n].values) > 0.0 for run in runs for n in names if n in run and len(run[n]))


def check_excitation(runs: Sequence[Trial], form: Form, signals: Sequence[str] | None = None) -> None:
    """Reject *runs* with too little information to diagnose *form*.

    signals : those to compare; None: all.

    Raises
    ------
    NotInformative
        There are too few samples, the inputs change once or never, or the motion is unrelated to the inputs.
    """
    there = [n for n in (signals or signals_of(form)) if any(n in run for run in runs)]
    samples = max((sum(len(run[n]) for run in runs if n in run) for n in there), default=0)
    if samples < FEWEST:
        raise NotInformative(
            f"{samples} samples are too few to identify a cause. At least {FEWEST} are needed, and 500 are better. "
            "Fly longer or log faster"
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
            f"the inputs ({', '.join(names)}) change only once. After a single step every cause looks like a "
            "different inertia or drag. Fly steps of several sizes both ways, a zig-zag or a relay"
        )


def _changes(channels: Sequence[Channel]) -> tuple[int, int]:
    """Return the number of large moves of an input, and the number of levels it stays at, over all runs."""
    low = min(float(c.values.min()) for c in channels)
    span = max(float(c.values.max()) for c in channels) - low
    if not span > 0.0:
        return 0, 1
    moves = 0
    spent = np.zeros(BINS)
    for c in channels:
        share = (c.values - low) / span
        at = np.minimum((BINS * share).astype(int), BINS - 1)
        spent += np.bincount(at, minlength=BINS)
        moves += _moves(share)
    return moves, int(np.sum(spent > DWELL * spent.sum()))


def _moves(share: Array) -> int:
    """Return the number of movements of a record (n,) in 0..1 by more than ``MOVE`` in one direction."""
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
            f"the motion ({', '.join(signals)}) does not follow the inputs ({', '.join(form.inputs)}). The inputs "
            f"explain {100 * best:.0f} % of it. Check that all columns come from one craft and one clock"
        )


GRID = 2000
"""Maximum number of samples of the common time grid of :func:`on_grid`."""

LAGS = np.geomspace(0.3, 300.0, 13)
"""Time constants tried, in steps of the common grid."""


def on_grid(*channels: Channel) -> tuple[float, list[Array]] | None:
    """Return a common time step [s] and all channels sampled on it by zero-order hold.

    The grid covers the overlap of the channels. Return None if they hardly overlap.
    """
    if any(len(c) < 2 for c in channels):
        return None
    start, end = max(float(c.t[0]) for c in channels), min(float(c.t[-1]) for c in channels)
    step = max(min(float(np.median(np.diff(c.t))) for c in channels), (end - start) / GRID)
    if not (end > start and step > 0.0) or (end - start) / step < 3 * len(LAGS):
        return None
    t = np.arange(start, end, step)
    return step, [c.values[np.searchsorted(c.t, t, side="right") - 1] for c in channels]


def coherence(follower: Array, leader: Array, *, integrated: bool = False) -> float:
    """Return the fraction of *follower*'s variance (n,) that the best first-order lag of *leader* (n,) explains.

    Gain, offset and initial state are free. The variance that offset and initial state explain alone does not count.

    integrated : compare with the integral of such a lag (a position).
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
    """Return the sum of squares of *y* (n,) after regression on the columns of *table* (n, k)."""
    norms = np.linalg.norm(table, axis=0)
    Q, R = np.linalg.qr(table[:, norms > 0.0] / norms[norms > 0.0])
    Q = Q[:, np.abs(np.diag(R)) > 1e-9]
    left = y - Q @ (Q.T @ y)
    return float(left @ left)


def held_share(values: Array) -> float:
    """Return the fraction of samples (n,) that repeat the previous one exactly; it is large for a held command."""
    return float(np.mean(np.diff(values) == 0.0)) if len(values) > 1 else 0.0
