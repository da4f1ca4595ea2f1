"""Conversion from the globe to a flat map and from the map to the body frame, common to telemetry and log readers."""

from __future__ import annotations

import math
from typing import TypeVar, cast

import numpy as np
from numpy.typing import NDArray

__all__ = ["flat", "from_flat", "to_body"]

EARTH = 6_378_137.0
"""Equatorial radius of WGS 84 [m].

The flat map needs an accuracy of only one metre per kilometre.
"""

Number = TypeVar("Number", float, NDArray[np.float64])


def flat(lat: Number, lon: Number, origin: tuple[float, float]) -> tuple[Number, Number]:
    """Return (north, east) [m] of *origin* for latitudes and longitudes [deg]."""
    north = (lat - origin[0]) * (math.pi / 180.0 * EARTH)
    shrink = math.cos(math.radians(origin[0]))
    east = ((lon - origin[1] + 180.0) % 360.0 - 180.0) * (math.pi / 180.0 * EARTH * shrink)
    return north, east


def from_flat(north: float, east: float, origin: tuple[float, float]) -> tuple[float, float]:
    """Return the position in degrees that is *north* and *east* [m] of *origin*; the reverse of :func:`flat`."""
    shrink = math.cos(math.radians(origin[0]))
    degrees = 180.0 / (math.pi * EARTH)
    return origin[0] + north * degrees, origin[1] + east * degrees / shrink


def to_body(north: Number, east: Number, psi: Number) -> tuple[Number, Number]:
    """Return velocity ahead and to starboard [m/s] from velocity north and east [m/s] and heading [rad]."""
    c, s = cast("Number", np.cos(psi)), cast("Number", np.sin(psi))
    return north * c + east * s, east * c - north * s
