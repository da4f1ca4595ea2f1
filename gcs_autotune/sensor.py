"""Properties of a sensor estimated from its samples: resolution, noise, and whether the craft moved."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

__all__ = ["INDEPENDENT", "TURN", "moves", "noise_of", "quantum", "stuck"]

Array = NDArray[np.float64]

INDEPENDENT = 0.05
"""Correlation of the errors of two neighbouring samples below which they count as independent. Project choice."""


def noise_of(values: Array) -> float:
    """Return the standard deviation of the noise of *values* (n,).

    It is calculated from second differences, which suppress slow motion.
    """
    second = np.diff(values, n=2)
    return 1.4826 * float(np.median(np.abs(second))) / math.sqrt(6.0) if len(second) else 0.0


MOVES = 2.0
"""Ratio of a velocity's standard deviation to that of its noise, above which the craft counts as moving.
Project choice.
"""


def moves(values: Array) -> bool:
    """Return whether a measured velocity (n,) varies by more than its own noise."""
    noise = float(np.std(np.diff(values))) / math.sqrt(2.0)
    return float(np.std(values)) > MOVES * noise


TURN = 2.0 * math.pi
"""Period of a heading [rad], for :func:`quantum`."""


ENOUGH_GAPS = 10
"""Number of gaps between levels from which a common grid cannot be due to chance, even if few levels repeat.

A gap without a grid lies near a multiple of the step with a probability of 0.04. Project choice.
"""


def quantum(values: Array, period: float = 0.0) -> float:
    """Return the quantisation step of a signal, in its unit; 0 if its values have no common grid.

    period : that of an angle that may turn several times; 0 otherwise. A long turn has a new level with every sample,
        but few within one period.
    """
    levels = np.unique(np.mod(values, period) if period else values)
    span = float(levels[-1] - levels[0]) if len(levels) else 0.0
    gaps = np.diff(levels)
    gaps = gaps[gaps > 1e-6 * span]
    is_repeated = 3 <= len(gaps) + 1 <= len(values) / 2
    if not (is_repeated or len(gaps) >= ENOUGH_GAPS):
        return 0.0
    step = float(gaps.min())
    multiples = gaps / step
    return step if np.all(np.abs(multiples - np.round(multiples)) < 0.02) else 0.0


STUCK_SAMPLES, STUCK_SECONDS = 20, 2.0
"""Smallest number of identical samples in a row, and their duration [s], that count as stuck. Project choice."""
CHANGING = 0.9
"""Smallest fraction of the other samples that differ from the one before. Below it, the sensor is coarse or its craft
at rest. Project choice.
"""


def stuck(t: Array, values: Array) -> list[tuple[int, int]]:
    """Return (first, last) of each stretch of identical samples, if all others change from one to the next.

    t : stamps (n,) [s]. values : (n,) or (n, k) for a sensor of k numbers, which are stuck together.
    """
    if len(t) < 2:
        return []
    changed = np.diff(values.reshape(len(t), -1), axis=0).any(axis=1)
    first = np.flatnonzero(np.concatenate([[True], changed]))
    last = np.append(first[1:] - 1, len(t) - 1)
    long = (last - first >= STUCK_SAMPLES - 1) & (t[last] - t[first] >= STUCK_SECONDS)
    others = len(t) - int(np.sum((last - first + 1)[long]))
    if int(np.sum(~long)) < CHANGING * max(others, STUCK_SAMPLES):
        return []
    return [(int(a), int(b)) for a, b in zip(first[long], last[long], strict=True)]
