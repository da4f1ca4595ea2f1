"""Rover's outputs: speed scaling of the steering, slew rate of the throttle, servo pulses."""

from __future__ import annotations

import math

from sitl.autopilot.parameters import ParameterStore
from sitl.autopilot.servo_rail import ServoRail
from sitl.autopilot.shaping import clamp, step_towards

__all__ = ["RoverMotors"]

_STEERING, _THROTTLE = 26, 70
"""SERVOn_FUNCTION."""
_ROUNDING = 1e-6
"""Pulses are cut to whole microseconds towards trim; this keeps 0.57 of 500 at 285."""


class RoverMotors:
    """Demands: ``steering`` as a fraction of full (may exceed 1, the servo does not), ``throttle`` in percent.

    ``limit_steer`` tells the rate controller that its integral must not grow: the servo is at its end, or the
    boat is slower than MOT_SPD_SCA_BASE.
    """

    def __init__(self, parameters: ParameterStore, dt: float) -> None:
        self._values = parameters.values
        self._dt = dt
        self.steering = 0.0
        self.throttle = 0.0
        self.limit_steer = False
        self.limit_throttle = False
        self._scaled = False
        self._servo = 0.0
        self._turned = 1.0
        self._last_throttle = 0.0

    def set_steering(self, fraction: float, *, scaled: bool) -> None:
        """Demand a steering output; *scaled*: reduced with speed, as the automatic modes do."""
        self.steering = fraction
        self._scaled = scaled

    def set_throttle(self, percent: float) -> None:
        """Demand a throttle of -100..100 percent."""
        top = self._values["MOT_THR_MAX"]
        self.throttle = clamp(percent, -top, top)

    def stop(self) -> None:
        """Drop every demand (disarmed)."""
        self.steering = self.throttle = self._last_throttle = self._servo = 0.0
        self.limit_steer = self.limit_throttle = False

    def output(self, rail: ServoRail, speed: float, *, armed: bool) -> None:
        """Write the pulses for a boat doing *speed* [m/s]."""
        if not armed:
            self.stop()
            silent = self._values["MOT_SAFE_DISARM"] != 0.0
            rail.write(lambda function, low, trim, high, sign: 0 if silent else trim)
            return
        self._slew()
        self._servo = self._scale(speed)
        rail.write(self._pulse)

    def _slew(self) -> None:
        rate = self._values["MOT_SLEWRATE"]
        wanted = self.throttle
        if rate > 0.0:
            self.throttle = step_towards(self._last_throttle, wanted, max(1.0, rate * self._dt))
        self.limit_throttle = self.throttle != wanted or abs(wanted) >= self._values["MOT_THR_MAX"]
        self._last_throttle = self.throttle

    def _scale(self, speed: float) -> float:
        steering, base = self.steering, self._values["MOT_SPD_SCA_BASE"]
        self.limit_steer = False
        self._turned = 1.0
        if self._scaled and self._values["MOT_VEC_ANGLEMAX"] > 0.0:
            steering = self._turn_thrust(steering)
        elif self._scaled:
            if 0.0 < base < abs(speed):
                steering *= base / abs(speed)
            else:
                self.limit_steer = True
            if speed < 0.0:
                steering = -steering
        if abs(steering) >= 1.0:
            self.limit_steer = True
        return clamp(steering, -1.0, 1.0)

    def _turn_thrust(self, steering: float) -> float:
        """Vectored thrust: steering is a sideways force, so the thrust is turned the less the more of it there is."""
        widest = math.radians(min(self._values["MOT_VEC_ANGLEMAX"], 90.0))
        throttle = self.throttle / 100.0
        limit = abs(throttle * math.tan(widest))
        if abs(steering) > limit:
            steering = math.copysign(limit, steering)
            self.limit_steer = True
        if throttle == 0.0:
            return steering
        angle = math.atan(steering / throttle)
        self._turned = math.cos(angle)
        return angle / widest

    def _pulse(self, function: int, low: int, trim: int, high: int, sign: int) -> int:
        if function == _STEERING:
            value = sign * self._servo
        elif function == _THROTTLE:
            value = sign * self._shape_throttle()
        else:
            return trim
        span = high - trim if value > 0.0 else trim - low
        return trim + int(value * span + math.copysign(_ROUNDING, value))

    def _shape_throttle(self) -> float:
        values = self._values
        size = min(abs(self.throttle) / 100.0 / max(self._turned, 1e-3), 1.0)
        if size == 0.0:
            return 0.0
        expo = values["MOT_THST_EXPO"]
        if expo != 0.0:
            size = ((expo - 1.0) + math.sqrt((1.0 - expo) ** 2 + 4.0 * expo * size)) / (2.0 * expo)
        floor = values["MOT_THR_MIN"] / 100.0
        return math.copysign(floor + size * (1.0 - floor), self.throttle)
