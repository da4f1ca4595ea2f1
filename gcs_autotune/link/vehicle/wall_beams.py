"""Two rangefinders that look ahead to port and to starboard: the distance to a flat wall and the angle to it."""

from __future__ import annotations

import math

from gcs_autotune.mavlink import Message, mavlink

__all__ = ["WallBeams", "yaw_of"]

_STEPS = 8
"""Orientations by yaw alone, in equal steps of a full turn."""
_CUSTOM = int(mavlink.MAV_SENSOR_ROTATION_CUSTOM)
_WIDEST = math.radians(60.0)
"""Largest angle of a beam to the bow at which it still counts as looking ahead. Project choice."""
_LEVEL = math.radians(10.0)
"""Largest angle of a beam to the horizontal. Project choice."""
_TOGETHER = 0.25
"""Longest time between the measurements of both beams [s]. Project choice."""


def yaw_of(m: Message) -> float | None:
    """Return where the rangefinder of a DISTANCE_SENSOR looks, from the bow to starboard [rad]; None if not ahead.

    Orientations 0 to 7 are yaw in steps of 45 degrees (MAV_SENSOR_ORIENTATION). With MAV_SENSOR_ROTATION_CUSTOM the
    message contains a quaternion.
    """
    yaw = math.inf
    if m.orientation < _STEPS:
        yaw = math.remainder(m.orientation * math.tau / _STEPS, math.tau)
    elif m.orientation == _CUSTOM:
        w, x, y, z = (float(value) for value in m.quaternion)
        size = w * w + x * x + y * y + z * z
        down = math.asin(max(-1.0, min(1.0, 2.0 * (w * y - x * z) / size))) if size > 0.0 else math.inf
        yaw = math.atan2(2.0 * (x * y + w * z), w * w + x * x - y * y - z * z) if abs(down) <= _LEVEL else math.inf
    return yaw if abs(yaw) <= _WIDEST else None


class WallBeams:
    """The last measurement of each of two beams from one place, one to each side of the bow."""

    def __init__(self) -> None:
        self._last: dict[bool, tuple[float, float, float]] = {}

    def add(self, t: float, yaw: float, distance: float) -> tuple[float, float] | None:
        """Add a measurement of the beam at *yaw* [rad] from the bow: *distance* [m], NaN beyond its range.

        Return the distance [m] straight ahead and the angle [rad] to the wall, the heading minus that at a right angle
        to it; NaN if a beam does not see the wall. None without a second beam at about the time *t* [s].
        """
        self._last[yaw > 0.0] = (t, yaw, distance)
        if len(self._last) < 2:  # port and starboard
            return None
        (t_port, yaw_port, port), (t_starboard, yaw_starboard, starboard) = self._last[False], self._last[True]
        if abs(t_port - t_starboard) > _TOGETHER:
            return None
        self._last.clear()
        ahead = starboard * math.cos(yaw_starboard), port * math.cos(yaw_port)
        aside = starboard * math.sin(yaw_starboard), port * math.sin(yaw_port)
        angle = math.atan2(ahead[0] - ahead[1], aside[0] - aside[1])
        return ahead[0] - aside[0] * math.tan(angle), angle
