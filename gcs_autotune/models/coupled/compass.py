"""Compass deviation: its effect on the heading, and on velocities rotated into the body frame with that heading.

The deviation is that of the compass adjuster, ``d = A + B sin(psi) + C cos(psi)``. A is the misalignment, B and C are
due to iron and electric currents on board. The ``u``, ``v`` of a log may come from a satellite receiver and the compass
heading. They then contain a false sway velocity ``-sin(d) u``, which is proportional to speed and changes sign with the
heading.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

__all__ = ["COEFFICIENTS", "seen_by_compass"]

Array = NDArray[np.float64]

COEFFICIENTS = ("A_psi", "B_psi", "C_psi")
"""Names of the coefficients A, B, C of the deviation [rad]."""

Output = tuple[Array, Array]
"""A signal (s,) and its sensitivities (s, q); the latter are (s, 0) if not requested."""


def seen_by_compass(
    signal: str, true: Mapping[str, Output], values: Mapping[str, float], columns: Mapping[str, int]
) -> Output:
    """Return *signal* (``u``, ``v`` or ``psi``) as measured with a deviating compass.

    Parameters
    ----------
    true : the true signals: ``psi``, and for a velocity ``u`` and ``v``.
    values : coefficients by name.
    columns : for each free coefficient, its column in the sensitivities.
    """
    psi, by_psi = true["psi"]
    sine, cosine = np.sin(psi), np.cos(psi)
    A, B, C = (values.get(n, 0.0) for n in COEFFICIENTS)
    d = A + B * sine + C * cosine
    by_d = (B * cosine - C * sine)[:, None] * by_psi
    for name, share in zip(COEFFICIENTS, (np.ones_like(psi), sine, cosine), strict=True):
        if name in columns and by_d.shape[1]:
            by_d[:, columns[name]] += share
    if signal == "psi":
        return psi + d, by_psi + by_d
    (u, by_u), (v, by_v) = true["u"], true["v"]
    cos_d, sin_d = np.cos(d), np.sin(d)
    along, across = cos_d * u + sin_d * v, cos_d * v - sin_d * u
    if signal == "u":
        return along, cos_d[:, None] * by_u + sin_d[:, None] * by_v + across[:, None] * by_d
    return across, cos_d[:, None] * by_v - sin_d[:, None] * by_u - along[:, None] * by_d
