"""Tracks: where the craft is between the stamps of a run, for effects that depend on the place; and the track that
follows from the measured heading, for disturbances that turn the craft.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.effects.effect import Drive
from gcs_autotune.smoothing import best_width, local_polynomials
from gcs_autotune.trial import Channel

__all__ = ["along_heading", "on_track"]

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


Predicted = tuple[Array, Array]
"""Values (n,) of a predicted signal, and their Jacobian (n, q)."""


def along_heading(
    track: tuple[Predicted, Predicted], heading: Predicted, t: Array, t_heading: Array, measured: Channel
) -> dict[str, Predicted]:
    """Return the predicted positions ``x`` and ``y`` with each step turned by the error of the predicted heading.

    A disturbance that turns the craft also moves it sideways, and this error adds up along the track. No simulation
    predicts it, but it follows from the *measured* heading.

    track : predicted ``x`` and ``y`` at the stamps *t* (n,). heading : predicted heading at the stamps *t_heading*.
    """
    (x, x_by), (y, y_by), (psi, psi_by) = *track, heading
    known = np.isfinite(measured.values)
    off = np.interp(t_heading, measured.t[known], np.unwrap(measured.values[known])) - psi
    every = np.union1d(t, t_heading)
    turn = np.exp(1j * np.interp(every, t_heading, np.unwrap(off)))
    by = np.column_stack([turn, *(-1j * turn * np.interp(every, t_heading, column) for column in psi_by.T)])
    summed = np.zeros_like(by)
    np.cumsum(0.5 * (by[1:] + by[:-1]) * np.diff(every)[:, None], axis=0, out=summed[1:])
    mean = np.diff(summed[np.searchsorted(every, t)], axis=0) / np.diff(t)[:, None]
    step, step_by = np.diff(x + 1j * y), np.diff(x_by + 1j * y_by, axis=0)
    moved = np.cumsum(np.concatenate([[x[0] + 1j * y[0]], mean[:, 0] * step]))
    first = x_by[:1] + 1j * y_by[:1]
    moved_by = np.cumsum(np.concatenate([first, mean[:, :1] * step_by + mean[:, 1:] * step[:, None]]), axis=0)
    return {"x": (moved.real, moved_by.real), "y": (moved.imag, moved_by.imag)}
