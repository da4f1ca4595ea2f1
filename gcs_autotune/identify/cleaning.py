"""Cleaning one channel: what is no number, stamps that repeat or run back, wrapped angles, coarse scales."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.errors import BadFile
from gcs_autotune.identify.result import Doubt
from gcs_autotune.trial import Channel

__all__ = ["clean", "quantum", "unwrap"]

Array = NDArray[np.float64]


JUMP_SAMPLES = 3
"""This many samples in a row older than one before them are a clock that jumped; fewer came late."""

LATE = 0.05
"""Largest share of late samples that may be left out. Chosen: beyond it the clock is not to be trusted."""


OVERTAKEN = 5.0
"""Median steps that a sample may come late and still be believed."""


def jumps_back(t: Array) -> NDArray[np.intp]:
    """Return the indices of the samples at which the clock restarts at an earlier time."""
    known = np.flatnonzero(np.isfinite(t))
    stamps = t[known]
    found = []
    for i in np.flatnonzero(np.diff(stamps) < 0.0) + 1:
        after = stamps[i : i + JUMP_SAMPLES]
        if len(after) == JUMP_SAMPLES and np.all(after < stamps[i - 1]) and np.all(np.diff(after) >= 0.0):
            found.append(known[i])
    return np.array(found, dtype=np.intp)


def clean(channel: Channel, run: str, notes: list[Doubt]) -> Channel:
    """Drop what is not a number, repeated stamps (the first stays); put late samples in order.

    Raises
    ------
    BadFile
        The clock jumps back.
    """
    good = np.isfinite(channel.t) & np.isfinite(channel.values)
    t, values = channel.t[good], channel.values[good]
    late = np.concatenate([[False], t[1:] < np.maximum.accumulate(t)[:-1]]) if len(t) else np.zeros(0, dtype=bool)
    jumps = jumps_back(t)
    if len(jumps) or late.sum() > max(1.0, LATE * len(t)):
        where = float(t[(jumps[0] if len(jumps) else int(np.argmax(late))) - 1])
        raise BadFile(
            f"the clock of run '{run}' jumps back after t = {where:.3f} s (channel {channel.name}): "
            "cut the file there and identify the parts as two runs"
        )
    t, values = _in_order(t, values, late)
    first = np.concatenate([[True], np.diff(t) > 0.0]) if len(t) else np.zeros(0, dtype=bool)
    lost, repeated = int((~good).sum()), int((~first).sum())
    if lost:
        notes.append(
            Doubt(
                "missing-samples",
                f"{lost} samples of {channel.name} in run '{run}' are not numbers",
                "check the sensor and the logger; the samples were left out",
            )
        )
    if late.any():
        notes.append(
            Doubt(
                "late-samples",
                f"{int(late.sum())} samples of {channel.name} in run '{run}' are older than the one before them",
                "log with the vehicle's own time stamps; they were put in order, or left out when far too old",
            )
        )
    if repeated > 0.02 * len(t):
        notes.append(
            Doubt(
                "repeated-stamps",
                f"{repeated} stamps of {channel.name} in run '{run}' are repeated",
                "log with the vehicle's own time stamps; the first sample of each stamp was kept",
            )
        )
    return replace(channel, t=t[first], values=values[first])


def _in_order(t: Array, values: Array, late: NDArray[np.bool_]) -> tuple[Array, Array]:
    """Put late samples where their stamps say; leave out those too late to have been merely overtaken."""
    if not late.any():
        return t, values
    behind = np.maximum.accumulate(t) - t
    keep = behind <= OVERTAKEN * float(np.median(np.diff(t[~late])))
    order = np.argsort(t[keep], kind="stable")
    return t[keep][order], values[keep][order]


def unwrap(t: Array, angle: Array, rate: Channel | None) -> Array:
    """Make *angle* [rad] continuous; over holes the turn is carried on at the measured or the last rate."""
    step = np.diff(angle)
    turns = np.round(step / (2.0 * np.pi))
    dt = np.diff(t)
    holes = np.flatnonzero(dt > 3.0 * np.median(dt)) if len(dt) else np.empty(0, dtype=int)
    for i in holes:
        turns[i] = np.round((step[i] - _turn_expected(t, angle, rate, int(i))) / (2.0 * np.pi))
    return np.concatenate([angle[:1], angle[1:] - 2.0 * np.pi * np.cumsum(turns)])


def _turn_expected(t: Array, angle: Array, rate: Channel | None, i: int) -> float:
    """Return the turn [rad] expected between samples *i* and *i* + 1."""
    if rate is not None and len(rate) > 1:
        grid = np.linspace(t[i], t[i + 1], 50)
        return float(np.trapezoid(np.interp(grid, rate.t, rate.values), grid))
    first = max(0, i - 3)
    if i == first:
        return 0.0
    recent = np.unwrap(angle[first : i + 1])
    return float((recent[-1] - recent[0]) / (t[i] - t[first]) * (t[i + 1] - t[i]))


def quantum(values: Array) -> float:
    """Return the step of a coarsely quantised signal, 0 when its values lie on no common grid."""
    levels = np.unique(values)
    span = float(levels[-1] - levels[0]) if len(levels) else 0.0
    if len(levels) < 3 or len(levels) > len(values) / 2 or span <= 0.0:
        return 0.0
    gaps = np.diff(levels)
    gaps = gaps[gaps > 1e-6 * span]
    step = float(gaps.min())
    multiples = gaps / step
    return step if np.all(np.abs(multiples - np.round(multiples)) < 0.02) else 0.0
