"""Find when the commands of a recorded run change, and by how much.

A held command changes in steps (switches). The time of a switch is only known to lie between two rows, so the midpoint
is used. A command that is never held comes from a joystick or a controller. Its changes are the segments from one
turning point to the next.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.diagnose.excitation_check import COMMANDS
from gcs_autotune.trial import Channel, Trial

__all__ = ["CHANGE", "Command", "commands_of"]

Array = NDArray[np.float64]

CHANGE = 0.1
"""Smallest change of a command that is used for matching, relative to the command's range."""

STEEP = 0.6
"""Least fraction of a command's total movement that is due to steps, for the command to count as held."""

MOST = 600
"""Maximum number of changes of one channel used for matching."""


@dataclass(frozen=True, slots=True, eq=False)
class Command:
    """A command that changes: stamps (n,) and values, scaled to its range (0 at its minimum).

    ``times``, ``sizes`` (k,): times [s] and sizes of its changes, relative to the range. ``row`` [s]: interval between
    rows; 0 if the command is stamped when it changes. ``is_held``: whether its changes are switches.
    """

    name: str
    t: Array
    x: Array
    span: float
    low: float
    times: Array
    sizes: Array
    row: float
    is_held: bool

    @property
    def usual(self) -> float:
        """Return the median time between two changes [s]."""
        return float(np.median(np.diff(self.times))) if len(self.times) > 2 else float(np.ptp(self.t)) / 3.0

    def at(self, t: Array) -> Array:
        """Return the command's values at *t* (n,), relative to the range: held, or interpolated if it is never held."""
        if not self.is_held:
            joined: Array = np.interp(t, self.t, self.x)
            return joined
        k = np.clip(np.searchsorted(self.t - 0.5 * self.row, t, side="right") - 1, 0, len(self.t) - 1)
        held: Array = self.x[k]
        return held


def commands_of(trial: Trial) -> dict[str, Command]:
    """Return the commands of a run that change: name -> command."""
    commands = {name: _command(trial[name]) for name in sorted(COMMANDS) if name in trial}
    return {name: c for name, c in commands.items() if c is not None}


def _command(channel: Channel) -> Command | None:
    """Return a command that changes; return None for a constant one."""
    good = np.isfinite(channel.t) & np.isfinite(channel.values)
    t, first = np.unique(channel.t[good], return_index=True)
    values = channel.values[good][first]
    if len(t) < 3 or float(np.ptp(values)) <= 1e-9 * float(np.abs(values).max()):
        return None
    low, span = float(values.min()), float(np.ptp(values))
    x = (values - low) / span
    steps, gaps = np.diff(x), np.diff(t)
    usual = float(np.median(gaps))
    in_rows = np.count_nonzero(steps) < 0.5 * len(x) or float(np.mean(np.abs(gaps - usual) < 0.2 * usual)) > 0.9
    row = usual if in_rows else 0.0
    noise = 1.4826 * float(np.median(np.abs(np.diff(x, n=3)))) / math.sqrt(20.0) if len(x) > 3 and row else 0.0
    times, sizes = _switches(t, steps, row, max(0.02, 6.0 * noise))
    moved = _moves(x, max(CHANGE, 6.0 * noise))
    held = float(np.abs(sizes).sum()) >= STEEP * float(np.abs(moved[1]).sum())
    if not held:
        times, sizes = t[moved[0]], moved[1]
    if not len(times):
        return None
    return Command(channel.name, t, x, span, low, times[:MOST], sizes[:MOST], row, held)


def _switches(t: Array, steps: Array, row: float, least: float) -> tuple[Array, Array]:
    """Return times and sizes of switches; neighbouring steps in one direction count as one."""
    large = np.flatnonzero(np.abs(steps) > least)
    if not len(large):
        return np.zeros(0), np.zeros(0)
    begins = np.flatnonzero(np.r_[True, (np.diff(large) > 1) | (np.diff(np.sign(steps[large])) != 0)])
    if row == 0.0:
        begins = np.arange(len(large))  # each stamp is a change of its own
    before = 0.5 * np.minimum(np.diff(t)[large], 1.5 * row)
    sizes = np.add.reduceat(steps[large], begins)
    weights = np.abs(steps[large])
    times = np.add.reduceat(weights * (t[large + 1] - before), begins) / np.add.reduceat(weights, begins)
    keep = np.abs(sizes) >= CHANGE
    return times[keep], sizes[keep]


def _moves(x: Array, least: float) -> tuple[NDArray[np.intp], Array]:
    """Return the middle sample and the size of each movement of a signal from one turning point to the next."""
    turns, low, high, way = [0], 0, 0, 0
    for k, value in enumerate(x.tolist()):
        high = k if value > x[high] else high
        low = k if value < x[low] else low
        if way >= 0 and value < x[high] - least:
            turns += [high] if high != turns[-1] else []
            way, low = -1, k
            high = k
        elif way <= 0 and value > x[low] + least:
            turns += [low] if low != turns[-1] else []
            way, high = 1, k
            low = k
    turns.append(high if way >= 0 else low)
    at = np.array(turns)
    sizes = np.diff(x[at])
    keep = np.abs(sizes) >= least
    return ((at[1:] + at[:-1]) // 2)[keep], sizes[keep]
