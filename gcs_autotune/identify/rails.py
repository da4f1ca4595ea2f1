"""Sensors at the end of their range: runs of identical extreme values that the motion enters and leaves at speed.

A craft at rest, or a coarse scale, dwells at an extreme too, but comes and goes slowly; a clipped signal breaks off.
Samples at a rail only say "at least so much" and are left out. Nothing else of the record is touched, so that no hole
arises where the input still acts.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.identify.cleaning import quantum
from gcs_autotune.identify.result import Doubt
from gcs_autotune.trial import Channel

__all__ = ["at_rails", "within_range"]

Array = NDArray[np.float64]

DWELL = 3
"""Fewest identical extreme samples in a row of a clip."""
SPEED = 0.3
"""Least step next to a dwell, as a share of the usual step of the signal."""
QUANTA = 3.0
"""The same in steps of the sensor's scale."""


def at_rails(channel: Channel) -> NDArray[np.bool_]:
    """Return which samples (n,) stand at a rail; none of them when the signal is not clipped."""
    x = channel.values
    none = np.zeros(len(x), dtype=bool)
    if len(x) < 10 * DWELL or np.ptp(x) == 0.0:
        return none
    starts = np.flatnonzero(np.concatenate([[True], np.diff(x) != 0.0]))
    lengths = np.diff(np.append(starts, len(x)))
    if np.median(lengths) >= DWELL - 1:  # a sensor slower than the log repeats every value
        return none
    steps = np.abs(np.diff(x))
    usual = float(np.median(steps[steps > 0.0]))
    least = max(SPEED * usual, QUANTA * quantum(x))
    rails = none.copy()
    for extreme in (float(x.max()), float(x.min())):
        dwells = [(int(s), int(n)) for s, n in zip(starts, lengths, strict=True) if x[s] == extreme and n >= DWELL]
        broken_off = [d for d in dwells if _breaks_off(x, *d, least)]
        if broken_off and len(broken_off) >= 0.5 * len(dwells) and not _levels_off(x, extreme, least):
            rails |= x == extreme
    return rails


def _levels_off(x: Array, extreme: float, least: float) -> bool:
    """Whether as many samples lie just short of the extreme as at it: a craft at its steady speed."""
    short = np.abs(x - extreme)
    return bool(np.sum((short > 0.0) & (short <= least)) >= np.sum(short == 0.0))


def _breaks_off(x: Array, start: int, length: int, least: float) -> bool:
    """Whether the signal comes to a dwell and leaves it at speed: the second steps before and after are not small."""
    before, after = start - 2, start + length + 1
    if before < 0 or after >= len(x):
        return False
    arriving, leaving = abs(x[start - 1] - x[before]), abs(x[after] - x[after - 1])
    return bool(min(arriving, leaving) > least)


def within_range(channel: Channel, run: str, notes: list[Doubt]) -> Channel:
    """Return *channel* without its samples at the rails of the sensor; what was left out is noted."""
    rails = at_rails(channel)
    if not rails.any():
        return channel
    worst = ", ".join(f"{v:.4g}" for v in sorted({float(v) for v in channel.values[rails]}))
    notes.append(
        Doubt(
            "clipped",
            f"{int(rails.sum())} samples of {channel.name} in run '{run}' stand at the end of its range "
            f"({worst} {channel.unit})",
            "use smaller inputs or a sensor of wider range; the samples were left out",
        )
    )
    return replace(channel, t=channel.t[~rails], values=channel.values[~rails])
