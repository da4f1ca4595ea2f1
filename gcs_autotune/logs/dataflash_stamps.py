"""Which stamps of a log on board are damaged: it carries no checksums, but its messages lie in order of time."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["strays_of"]

Array = NDArray[np.float64]

STRAY = 2.0
"""Chosen [s]: a stamp so much before, or after, the middle one of its neighbours on both sides is damaged."""
FAR = 600.0
"""Chosen [s]: so far from the only neighbours there are it is damaged, too."""
NEIGHBOURS = 5
"""Chosen: messages looked at on either side."""


def strays_of(t: Array) -> NDArray[np.bool_]:
    """Return which stamps, in order of the file, lie before both their neighbourhoods or after both.

    Where there is only one (the ends of a piece), a stamp far from it is a stray, too.
    """
    if not np.any(~(np.abs(np.diff(t)) <= STRAY)):
        return np.zeros(len(t), dtype=bool)
    beyond = np.full(NEIGHBOURS, np.nan)
    windows = np.lib.stride_tricks.sliding_window_view(np.concatenate([beyond, t, beyond]), NEIGHBOURS)
    middle = np.median(windows, axis=1)
    before, after = middle[: len(t)], middle[NEIGHBOURS + 1 : NEIGHBOURS + 1 + len(t)]
    is_ahead = (t > before + STRAY) & (t > after + STRAY)
    is_behind = (t < before - STRAY) & (t < after - STRAY)
    is_alone = np.isnan(before) | np.isnan(after)
    nearest = np.fmin(np.abs(t - before), np.abs(t - after))
    strays: NDArray[np.bool_] = is_ahead | is_behind | (is_alone & (nearest > FAR)) | ~np.isfinite(t)
    return strays
