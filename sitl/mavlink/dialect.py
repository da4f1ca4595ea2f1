"""The one door to pymavlink's generated code (untyped)."""

from __future__ import annotations

from typing import Any

from pymavlink.dialects.v20 import ardupilotmega

__all__ = ["Message", "mavlink"]

mavlink: Any = ardupilotmega
"""Constants and message classes of the ardupilotmega dialect, MAVLink 2."""
Message = Any
"""A decoded message, or one about to be sent."""
