"""Distance to a flat surface from two laser dots in a camera picture (Miskovic2010, 3.4).

The distance of each dot from the picture's centre gives the length of its beam: ``L = a exp(b x) + c exp(d x)`` (3.9).
The two lengths give the craft's distance (3.8) and its angle to the surface.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import brentq, least_squares

from gcs_autotune.errors import NotInformative

__all__ = ["LaserCurve", "calibrate"]

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class LaserCurve:
    """Curve from a dot's distance from the picture's centre to the length of its beam.

    ``a``, ``c`` are in the unit of the distance, ``b``, ``d`` per pixel (Miskovic2010, Table 3.1: per cm).
    """

    a: float
    b: float
    c: float
    d: float

    def length(self, pixels: ArrayLike) -> Array:
        """Return the beam's length at *pixels* from the picture's centre, any shape (Miskovic2010, eq. (3.9))."""
        x = np.asarray(pixels, dtype=np.float64)
        value: Array = self.a * np.exp(self.b * x) + self.c * np.exp(self.d * x)
        return value

    def pixels(self, length: float) -> float:
        """Return the position of the dot of a beam of that *length*; it is unique, because the curve falls.

        Raises
        ------
        NotInformative
            A length of 0 or less, or a length beyond the picture's centre.
        """
        if not 0.0 < length <= float(self.length(0.0)):
            raise NotInformative(
                f"a distance of {length:g} is outside the calibrated range (0 to {float(self.length(0.0)):g}). "
                "Calibrate over a wider range"
            )
        far = 1.0
        while float(self.length(far)) > length:
            far *= 2.0
        return float(brentq(lambda x: float(self.length(x)) - length, 0.0, far))


def calibrate(pixels: Sequence[float] | Array, lengths: Sequence[float] | Array) -> LaserCurve:
    """Fit the curve to pairs measured at right angles to a surface.

    The *lengths* themselves are fitted, not their logarithms, because a tape measure has constant errors.

    Raises
    ------
    NotInformative
        Fewer than five pairs, or all at one place.
    """
    x, y = np.asarray(pixels, dtype=np.float64), np.asarray(lengths, dtype=np.float64)
    if len(x) < 5 or float(np.ptp(x)) <= 0.0 or float(y.min()) <= 0.0:
        raise NotInformative("a laser calibration needs at least five different distances above 0")
    near = x > np.median(x)
    slope = float(np.polyfit(x[near], np.log(y[near]), 1)[0])
    best = min((_fit(x, y, slope * steeper, slope) for steeper in (2.0, 4.0, 8.0)), key=lambda found: found[1])
    return best[0]


def _fit(x: Array, y: Array, b: float, d: float) -> tuple[LaserCurve, float]:
    """Search over the two rates; for given rates the two amplitudes follow from linear least squares."""

    def amplitudes(rates: Array) -> tuple[Array, Array]:
        table = np.exp(np.outer(x, rates))
        found = np.asarray(np.linalg.lstsq(table, y, rcond=None)[0], dtype=np.float64)
        return found, np.asarray(table @ found - y, dtype=np.float64)

    scale = abs(d)

    def error_of(p: Array) -> Array:
        return amplitudes(p * scale)[1]

    found = least_squares(error_of, np.array([b, d]) / scale, xtol=1e-14, ftol=1e-14)
    rates = np.sort(found.x * scale)
    (a, c), error = amplitudes(rates)
    return LaserCurve(float(a), float(rates[0]), float(c), float(rates[1])), float(error @ error)
