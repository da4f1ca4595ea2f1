"""The one door to pymavlink's generated code (untyped)."""

from __future__ import annotations

from typing import Any

from pymavlink.dialects.v20 import ardupilotmega

__all__ = ["Message", "fit_float", "mavlink"]

mavlink: Any = ardupilotmega
"""Constants and message classes of the ardupilotmega dialect, MAVLink 2."""
Message = Any
"""A decoded message, or one about to be sent."""
_LARGEST_FLOAT = 3.4028234e38


def fit_float(value: float) -> float:
    """Return *value* kept within what a float field of a message can hold."""
    return max(-_LARGEST_FLOAT, min(_LARGEST_FLOAT, value))
