"""Helm orders: when the rudder was put over from one side to the other, and when it got there."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.identify.ship.log import ShipLog

__all__ = ["Execute", "find_executes"]

Array = NDArray[np.float64]

HALF = 0.5
"""Fraction of the helm at which a reversal counts; where it began is traced back from there."""

QUIET = 0.08
"""Deviation from a held helm, as a fraction of the reversal, that is not yet its beginning."""


@dataclass(frozen=True, slots=True)
class Execute:
    """A helm order: given at ``t`` [s], carried out by ``done``, from ``before`` to ``level`` [unit of the input]."""

    t: float
    done: float
    before: float
    level: float


def find_executes(log: ShipLog) -> tuple[Execute, ...]:
    """Return the helm orders that put the rudder over from one side to the other, the first from amidships included."""
    t, v = log.steering.t, log.steering.values
    high, low = float(np.percentile(v, 98)), float(np.percentile(v, 2))
    high, low = (float(np.median(v[v >= low + 0.9 * (high - low)])), float(np.median(v[v <= low + 0.1 * (high - low)])))
    if high <= 0.0 or low >= 0.0:
        return ()
    state, found = 0, []
    last = 0
    for i, x in enumerate(v):
        new = 1 if x > HALF * high else -1 if x < HALF * low else state
        if new != state and new != 0:
            level = high if new > 0 else low
            before = 0.0 if state == 0 else (high if state > 0 else low)
            found.append(_traced(t, v, last, i, before, level))
            state, last = new, i
    return tuple(_levelled(t, v, found, float(t[-1])))


def _traced(t: Array, v: Array, first: int, i: int, before: float, level: float) -> Execute:
    """Return the order whose ramp passes sample *i*: from where the old level was left to where the new is reached."""
    band = QUIET * abs(level - before)
    held = np.flatnonzero(np.abs(v[first:i] - before) <= band)
    begin = first + int(held[-1]) if len(held) else first
    reached = np.flatnonzero(np.abs(v[i:] - level) <= band)
    done = i + int(reached[0]) if len(reached) else i
    if i - begin <= 1 and done == i:  # a jump: in force from its own stamp on
        return Execute(float(t[i]), float(t[i]), before, level)
    ramp = slice(begin, done + 1)
    inner = np.abs(v[ramp] - 0.5 * (before + level)) < 0.4 * abs(level - before)
    if int(inner.sum()) >= 3:
        slope, middle = np.polyfit(t[ramp][inner] - t[i], v[ramp][inner], 1)
        if slope * (level - before) > 0.0:
            start = float(t[i]) + (before - middle) / slope
            return Execute(float(np.clip(start, t[first], t[i])), float(t[done]), before, level)
    return Execute(float(t[min(begin + 1, i)]), float(t[done]), before, level)


def _levelled(t: Array, v: Array, executes: list[Execute], end: float) -> list[Execute]:
    """Return the orders with the levels really held after each."""
    mended: list[Execute] = []
    for k, e in enumerate(executes):
        until = executes[k + 1].t if k + 1 < len(executes) else end
        keep = (t >= e.done) & (t < until)
        level = float(np.median(v[keep])) if keep.any() else e.level
        mended.append(replace(e, level=level, before=mended[-1].level if mended else e.before))
    return mended
