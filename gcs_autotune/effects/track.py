"""Where the craft is between the stamps of a run, from its recorded positions: for effects that depend on the place."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.effects.effect import Drive
from gcs_autotune.smoothing import best_width, local_polynomials
from gcs_autotune.trial import Channel

__all__ = ["on_track"]

Array = NDArray[np.float64]

WIDTHS = (5, 9, 15, 25)
"""Numbers of samples over which recorded positions may be smoothed. Project choice."""


def on_track(drive: Drive, names: Sequence[str]) -> tuple[Drive, Array, Array, Array | None]:
    """Return *drive* with the stamps of the recorded positions *names* as well, and where the craft is between stamps.

    That is: smoothed positions and their rates (k, j), and the continuous heading (j,), None if not recorded. All are
    half-way from each stamp to the next.
    """
    own = drive.measured
    drive = drive.on(np.union1d(drive.t, own[names[0]].t))
    middle = 0.5 * (drive.t + np.append(drive.t[1:], drive.t[-1]))
    paths = [[np.interp(middle, t, values) for values in rest] for t, *rest in map(_path, (own[n] for n in names))]
    heading = None
    if "psi" in own:
        known = np.isfinite(own["psi"].values)
        heading = np.interp(middle, own["psi"].t[known], np.unwrap(own["psi"].values[known]))
    return drive, np.array([place for place, _ in paths]), np.array([rate for _, rate in paths]), heading


@lru_cache(maxsize=64)
def _path(place: Channel) -> tuple[Array, Array, Array]:
    """Return the stamps of the valid samples of a position, and its smoothed values and rates (n,)."""
    good = np.isfinite(place.values)
    t, values = place.t[good], place.values[good]
    widths = [w for w in WIDTHS if 3 * w <= len(values)]
    if not widths:
        return t, values, np.gradient(values, t) if len(t) > 1 else np.zeros(len(t))
    width, _ = best_width(t, values, widths, degree=2)
    fitted = local_polynomials(t, values, t, width, degree=2)
    return t, fitted.derivative(0), fitted.derivative(1)
