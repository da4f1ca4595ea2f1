"""Properties of a sensor estimated from its samples: resolution, noise, and whether the craft moved."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

__all__ = ["INDEPENDENT", "moves", "noise_of", "quantum"]

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


def quantum(values: Array) -> float:
    """Return the quantisation step of a signal, in its unit; 0 if its values have no common grid."""
    levels = np.unique(values)
    span = float(levels[-1] - levels[0]) if len(levels) else 0.0
    if len(levels) < 3 or len(levels) > len(values) / 2 or span <= 0.0:
        return 0.0
    gaps = np.diff(levels)
    gaps = gaps[gaps > 1e-6 * span]
    step = float(gaps.min())
    multiples = gaps / step
    return step if np.all(np.abs(multiples - np.round(multiples)) < 0.02) else 0.0
