"""One channel of a drive redrawn at stamps of its own, the others held as they were."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.effects.effect import Drive

__all__ = ["redrawn"]

Array = NDArray[np.float64]


def redrawn(drive: Drive, name: str, t: Array, values: Array) -> Drive:
    """Return *drive* with channel *name* holding *values* (k,) from the stamps *t* (k,) on.

    A lone channel has these stamps only; with others there the stamps of both are merged.
    """
    if len(drive.channels) == 1:
        return replace(drive, t=t, channels={name: values})
    together = np.union1d(drive.t, t)
    at = np.maximum(np.searchsorted(t, together, side="right") - 1, 0)
    return drive.on(together).with_channel(name, values[at])
