"""ArduSub's yaw stick in the stabilised modes: a turn rate, beyond a dead zone that the joystick gain scales."""

from __future__ import annotations

import math
from dataclasses import dataclass

from gcs_autotune.firmware import Firmware
from gcs_autotune.link.parameters import Parameters

__all__ = ["RateStick", "read_rate_stick"]

_FULL_STICK = math.radians(45.0)
"""Yaw input of a full stick [rad/s] before ACRO_YAW_P; measured: 152 deg/s at ACRO_YAW_P 3.375."""
_USUAL_GAIN = 0.5
_NAMES = ("ACRO_YAW_P", "RC4_DZ", "RC4_MAX", "RC4_TRIM", "JS_GAIN_DEFAULT")


@dataclass(frozen=True, slots=True)
class RateStick:
    """``full_rate`` [rad/s] of a full stick; ``dead_zone`` share of the stick's travel at joystick gain 1;
    ``usual_gain`` the gain in force as long as the vehicle does not tell another."""

    full_rate: float
    dead_zone: float
    usual_gain: float = _USUAL_GAIN

    def deflection(self, rate: float, gain: float) -> float:
        """Return the stick [-1, 1] that asks for *rate* [rad/s] at joystick *gain* (NaN when not told)."""
        if rate == 0.0:
            return 0.0
        dead = self.dead_zone * (gain if math.isfinite(gain) else self.usual_gain)
        size = dead + abs(rate) / self.full_rate * (1.0 - dead)
        return math.copysign(min(size, 1.0), rate)


def read_rate_stick(parameters: Parameters, firmware: Firmware) -> RateStick | None:
    """Ask the vehicle what its yaw stick means; None for one that takes turn rates as targets."""
    if firmware.kind != "rov":
        return None
    known = parameters.read_existing(_NAMES)
    travel = known.get("RC4_MAX", 1900.0) - known.get("RC4_TRIM", 1500.0)
    return RateStick(
        _FULL_STICK * known.get("ACRO_YAW_P", 3.375),
        known.get("RC4_DZ", 40.0) / travel if travel > 0.0 else 0.0,
        known.get("JS_GAIN_DEFAULT", _USUAL_GAIN),
    )
