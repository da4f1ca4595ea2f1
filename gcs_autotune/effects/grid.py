"""The grid on which all readings of a signal lie, if they do."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["TOLERANCE", "grid_step"]

Array = NDArray[np.float64]

TOLERANCE = 0.02
"""Share of a step that a reading may lie beside the grid: files hold rounded numbers."""
FINEST = 1e-5
"""A grid finer than this share of the range is not looked for."""


def grid_step(values: Array) -> float:
    """Return the distance of neighbours on the coarsest grid that holds all *values* (n,), as recorded; 0: none.

    An angle is to be given as it was recorded, before it is unwrapped: a turn need not be a multiple of the step.
    """
    ordered = np.sort(values[np.isfinite(values)])
    if len(ordered) < 10 or ordered[-1] == ordered[0]:
        return 0.0
    gaps = np.diff(ordered)
    gaps = gaps[gaps > FINEST * (ordered[-1] - ordered[0])]
    # A grid brings readings together: of so many, some are equal.
    if len(gaps) == 0 or len(gaps) > 0.9 * (len(ordered) - 1):
        return 0.0
    for parts in (1, 2, 3):
        step = float(gaps.min()) / parts
        counts = np.round(gaps / step)
        step = float(gaps @ counts / (counts @ counts))
        if float(np.max(np.abs(gaps / step - np.round(gaps / step)))) < TOLERANCE:
            return step
    return 0.0
