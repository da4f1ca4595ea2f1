"""An off-centre sensor: its measured velocity and position, and its depth if the craft tilts.

The sensor is ``x_P`` ahead and ``y_P`` to starboard of the point to which the equations refer. Its velocity is that of
a point of a rigid body, ``v + omega x r_P``. Turning looks like sway at a sensor ahead, and like surge at a sensor
abeam.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

__all__ = ["LEVER_ARM", "SHOWN_OFF_CENTRE", "seen_off_centre"]

Array = NDArray[np.float64]

LEVER_ARM = ("x_P", "y_P")
"""Names of the sensor's coordinates [m] ahead and to starboard."""

SHOWN_OFF_CENTRE: Mapping[str, tuple[str, ...]] = {
    "u": ("r",),
    "v": ("r",),
    "x": ("psi",),
    "y": ("psi",),
    "z": ("theta", "phi"),
    "w": ("q", "p"),
}
"""Signal -> states that an off-centre sensor adds to it."""

Output = tuple[Array, Array]
"""A signal (s,) and its sensitivities (s, q); the latter are (s, 0) if not requested."""


def seen_off_centre(
    signal: str, true: Mapping[str, Output], arm: tuple[float, float], columns: Mapping[str, int]
) -> Output:
    """Return *signal*, one of :data:`SHOWN_OFF_CENTRE`, as measured at *arm* ``(x_P, y_P)``; tilt to first order.

    Parameters
    ----------
    true : the true signals: *signal* itself, and those of the added states that are available.
    columns : the columns of ``x_P`` and ``y_P`` in the sensitivities, if they are free.
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
    """Return for each added state its contribution per metre of ``x_P`` and ``y_P``, and the derivative of the sum by
    it."""
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
