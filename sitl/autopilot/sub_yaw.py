"""Sub's yaw loops: shaped heading target, square-root heading law, rate PID (as AC_AttitudeControl does)."""

from __future__ import annotations

import math

from sitl.autopilot.parameters import ParameterStore
from sitl.autopilot.pid import Pid
from sitl.autopilot.shaping import clamp, sqrt_controller, step_towards, wrap_pi

__all__ = ["SubYawController"]

_LEAST_ACCELERATION, _MOST_ACCELERATION = math.radians(10.0), math.radians(120.0)
"""Bounds of the square-root controller's deceleration, fixed in the firmware."""


class SubYawController:
    """Holds or turns the heading. Radians; the output is a fraction of full yaw. ATC_RAT_YAW_FF has no effect."""

    def __init__(self, parameters: ParameterStore, dt: float) -> None:
        self._values = parameters.values
        self._dt = dt
        self.pid = Pid(parameters, "ATC_RAT_YAW")
        self._target = 0.0
        self._target_rate = 0.0

    def reset(self, yaw: float) -> None:
        """Forget the past; the target is the present heading."""
        self.pid.reset()
        self._target = yaw
        self._target_rate = 0.0

    def hold(self, heading: float) -> None:
        """Move the target towards *heading*, shaped by ATC_INPUT_TC, ATC_ACCEL_Y_MAX and ATC_SLEW_YAW."""
        values = self._values
        error = wrap_pi(heading - self._target)
        if not values["ATC_RATE_FF_ENAB"]:
            self._target, self._target_rate = heading, 0.0
            return
        wanted = sqrt_controller(error, 1.0 / max(values["ATC_INPUT_TC"], 0.01), self._acceleration(), self._dt)
        self._approach_rate(wanted)
        top = math.radians(values["ATC_SLEW_YAW"] / 100.0)
        if top > 0.0:
            self._target_rate = clamp(self._target_rate, -top, top)

    def turn(self, rate: float) -> None:
        """Turn the target at *rate* [rad/s]."""
        self._approach_rate(rate)

    def run(self, yaw: float, rate: float, limited: bool) -> float:
        """Return the yaw output for the measured *yaw* and *rate*."""
        values, dt = self._values, self._dt
        p = values["ATC_ANG_YAW_P"]
        self._target = wrap_pi(self._target + self._target_rate * dt)
        error = wrap_pi(self._target - yaw)
        if p > 0.0 and abs(error) > _MOST_ACCELERATION / p:
            error = math.copysign(_MOST_ACCELERATION / p, error)
            self._target = wrap_pi(yaw + error)
        limit = clamp(0.5 * self._acceleration(), _LEAST_ACCELERATION, _MOST_ACCELERATION)
        wanted = sqrt_controller(error, p, limit, dt) + self._target_rate
        top = math.radians(values["ATC_RATE_Y_MAX"])
        if top > 0.0:
            wanted = clamp(wanted, -top, top)
        return clamp(self.pid.update(wanted, rate, dt, limited), -1.0, 1.0)

    def _acceleration(self) -> float:
        return math.radians(self._values["ATC_ACCEL_Y_MAX"] / 100.0)

    def _approach_rate(self, wanted: float) -> None:
        limit = self._acceleration()
        self._target_rate = step_towards(self._target_rate, wanted, limit * self._dt) if limit > 0.0 else wanted
