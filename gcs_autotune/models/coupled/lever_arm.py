"""A sensor off the centre: what it shows of velocity and position, and of depth where the craft tilts.

At ``x_P`` ahead and ``y_P`` to starboard of the point the equations are written for, the velocity is that of a point
of a rigid body, ``v + omega x r_P``: turning looks like sway at a sensor ahead, like surge at one to the side.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

__all__ = ["LEVER_ARM", "SHOWN_OFF_CENTRE", "seen_off_centre"]

Array = NDArray[np.float64]

LEVER_ARM = ("x_P", "y_P")
"""Place of the sensor [m] ahead and to starboard."""

SHOWN_OFF_CENTRE: Mapping[str, tuple[str, ...]] = {
    "u": ("r",),
    "v": ("r",),
    "x": ("psi",),
    "y": ("psi",),
    "z": ("theta", "phi"),
    "w": ("q", "p"),
}
"""Signal -> states that a sensor off the centre mixes into it."""

Output = tuple[Array, Array]
"""A signal (s,) and its sensitivities (s, q); the latter (s, 0) when not asked for."""


def seen_off_centre(
    signal: str, true: Mapping[str, Output], arm: tuple[float, float], columns: Mapping[str, int]
) -> Output:
    """Return *signal*, of :data:`SHOWN_OFF_CENTRE`, as a sensor at *arm* ``(x_P, y_P)`` shows it; tilt to first order.

    Parameters
    ----------
    true : the true signals: *signal* itself and what is mixed into it, as far as there is any.
    columns : the sensitivity's column of ``x_P`` and ``y_P``, where they are free.
    """
    x_P, y_P = arm
    value, by = true[signal]
    shares = []
    for mixed, (by_x, by_y, slope) in _shares(signal, true, arm).items():
        value, by = value + x_P * by_x + y_P * by_y, by + slope[:, None] * true[mixed][1]
        shares += [("x_P", by_x), ("y_P", by_y)]
    for name, share in shares:
        if name in columns and by.shape[1]:
            by[:, columns[name]] += share
    return value, by


def _shares(
    signal: str, true: Mapping[str, Output], arm: tuple[float, float]
) -> Mapping[str, tuple[Array, Array, Array]]:
    """Return state mixed in -> what each metre of ``x_P`` and ``y_P`` adds, and the derivative of the sum by it."""
    x_P, y_P = arm
    found = {}
    for mixed in (n for n in SHOWN_OFF_CENTRE[signal] if n in true):
        value = true[mixed][0]
        one, none = np.ones_like(value), np.zeros_like(value)
        sine, cosine = np.sin(value), np.cos(value)
        found[mixed] = {
            ("u", "r"): (none, -value, -y_P * one),
            ("v", "r"): (value, none, x_P * one),
            ("x", "psi"): (cosine, -sine, -x_P * sine - y_P * cosine),
            ("y", "psi"): (sine, cosine, x_P * cosine - y_P * sine),
            ("z", "theta"): (-sine, none, -x_P * cosine),
            ("z", "phi"): (none, sine, y_P * cosine),
            ("w", "q"): (-value, none, -x_P * one),
            ("w", "p"): (none, value, y_P * one),
        }[signal, mixed]
    return found
