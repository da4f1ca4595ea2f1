"""Properties of a sensor estimated from its samples: resolution, noise, and whether the craft moved."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

__all__ = ["INDEPENDENT", "TURN", "moves", "noise_of", "quantum"]

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
