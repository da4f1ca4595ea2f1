"""Places on the globe and on the plane that is flown on: metres north + i east of the origin."""

from __future__ import annotations

import math

__all__ = ["HOME", "METRES_PER_DEGREE", "to_globe", "to_plane"]

HOME = 44.4250, 8.7640
"""Chosen: Genoa Pra harbour, latitude and longitude [deg], where Miskovic2010's boat was tried."""
METRES_PER_DEGREE = 111319.5
_SHRINK = math.cos(math.radians(HOME[0]))
_E7 = 1e7


def to_globe(place: complex) -> tuple[int, int]:
    """Return latitude and longitude [1e-7 deg] of a *place* [m]."""
    latitude = HOME[0] + place.real / METRES_PER_DEGREE
    longitude = HOME[1] + place.imag / (METRES_PER_DEGREE * _SHRINK)
    return round(latitude * _E7), round(longitude * _E7)


def to_plane(latitude: int, longitude: int) -> complex:
    """Return the place [m] at a *latitude* and *longitude* [1e-7 deg]."""
    north = (latitude / _E7 - HOME[0]) * METRES_PER_DEGREE
    east = (longitude / _E7 - HOME[1]) * METRES_PER_DEGREE * _SHRINK
    return complex(north, east)
