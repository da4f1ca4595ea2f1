"""Rover's outputs: speed scaling of the steering, slew rate of the throttle, skid mixing, servo pulses."""

from __future__ import annotations

import math

from sitl.autopilot.parameters import ParameterStore
from sitl.autopilot.servo_rail import ServoRail
from sitl.autopilot.shaping import clamp, step_towards

__all__ = ["RoverMotors"]

_STEERING, _THROTTLE, _LEFT, _RIGHT = 26, 70, 73, 74
"""Values of SERVOn_FUNCTION for steering, throttle, and the left and right throttle of a skid-steered boat."""
_MOST_FLOOR = 20.0
"""Largest MOT_THR_MIN [%] that ArduRover uses (``sanity_check_parameters``)."""
_ROUNDING = 1e-6
"""Tolerance for pulses, which are truncated to whole microseconds towards trim. It keeps 0.57 of 500 at 285."""


class RoverMotors:
    """Demands: ``steering`` as a fraction of full (it may exceed 1; the servo output is limited), ``throttle`` in
    percent.

    ``limit_left``, ``limit_right`` and, for either, ``limit_steer`` stop the integrals of the loops above: the servo is
    at its end, or the boat is slower than MOT_SPD_SCA_BASE. A boat with outputs for left and right throttle steers by
    their difference: never scaled with speed, and what does not fit is shared out by MOT_STR_THR_MIX.
    """

    def __init__(self, parameters: ParameterStore, dt: float) -> None:
        self._values = parameters.values
        self._dt = dt
        self.steering = 0.0
        self.throttle = 0.0
        self.limit_left = self.limit_right = False
        self.limit_throttle = False
        self._scaled = False
        self._servo = 0.0
        self._turned = 1.0
        self._left = self._right = 0.0
        self._last_throttle = 0.0

    @property
    def limit_steer(self) -> bool:
        """Whether the steering is at its end to either side."""
        return self.limit_left or self.limit_right

    @property
    def skid(self) -> bool:
        """Whether the boat steers by two thrusters: a left and a right throttle output are assigned."""
        assigned = {int(self._values[f"SERVO{n}_FUNCTION"]) for n in range(1, 9)}
        return {_LEFT, _RIGHT} <= assigned

    def set_steering(self, fraction: float, *, scaled: bool) -> None:
        """Set the steering demand, a fraction of full. *scaled*: reduce it with speed, as in the automatic modes."""
        self.steering = fraction
        self._scaled = scaled

    def set_throttle(self, percent: float) -> None:
        """Set the throttle demand [%], -100 to 100."""
        top = self._values["MOT_THR_MAX"]
        self.throttle = clamp(percent, -top, top)

    def stop(self) -> None:
        """Clear all demands, because the vehicle is disarmed."""
        self.steering = self.throttle = self._last_throttle = self._servo = self._left = self._right = 0.0
        self.limit_left = self.limit_right = self.limit_throttle = False

    def output(self, rail: ServoRail, speed: float, *, armed: bool) -> None:
        """Write the demands to the servo pulses, with the steering scaled for *speed* [m/s]."""
        if not armed:
            self.stop()
            silent = self._values["MOT_SAFE_DISARM"] != 0.0
            rail.write(lambda function, low, trim, high, sign: 0 if silent else trim)
            return
        self._slew()
        skid = self.skid
        self._servo = self._scale(speed, skid=skid)
        if skid:
            self._mix()
        rail.write(self._pulse)

    def _slew(self) -> None:
        rate = self._values["MOT_SLEWRATE"]
        wanted = self.throttle
        if rate > 0.0:
            self.throttle = step_towards(self._last_throttle, wanted, rate * self._dt)
        self.limit_throttle = self.throttle != wanted or abs(wanted) >= self._values["MOT_THR_MAX"]
        self._last_throttle = self.throttle

    def _scale(self, speed: float, *, skid: bool) -> float:
        steering, base = self.steering, self._values["MOT_SPD_SCA_BASE"]
        self.limit_left = self.limit_right = False
        self._turned = 1.0
        if self._scaled and self._values["MOT_VEC_ANGLEMAX"] > 0.0:
            steering = self._turn_thrust(steering)
        elif self._scaled:
            if 0.0 < base < abs(speed):
                steering *= base / abs(speed)
            elif not skid:
                self.limit_left = self.limit_right = True
            if speed < 0.0:
                steering = -steering
        self.limit_left = self.limit_left or steering <= -1.0
        self.limit_right = self.limit_right or steering >= 1.0
        return clamp(steering, -1.0, 1.0)

    def _turn_thrust(self, steering: float) -> float:
        """Return the steering for vectored thrust. It is a sideways force, so more thrust needs a smaller angle."""
        widest = math.radians(min(self._values["MOT_VEC_ANGLEMAX"], 90.0))
        throttle = self.throttle / 100.0
        limit = abs(throttle * math.tan(widest))
        if abs(steering) > limit:
            steering = math.copysign(limit, steering)
            self.limit_left = self.limit_right = True
        if throttle == 0.0:
            return steering
        angle = math.atan(steering / throttle)
        self._turned = math.cos(angle)
        return angle / widest

    def _mix(self) -> None:
        """Distribute throttle and steering to the two thrusters within their limits."""
        values = self._values
        asymmetry = max(values["MOT_THST_ASYM"], 1.0)
        floor = -1.0 / asymmetry
        best = 0.5 * (1.0 + floor)
        throttle, wanted = clamp(self.throttle / 100.0, floor, 1.0), clamp(self.steering, -1.0, 1.0)
        reach = max(throttle, 0.0) - floor if throttle < best else 1.0 - best
        steering = clamp(wanted, -reach, reach)
        full = max(throttle + abs(steering), (throttle - abs(steering)) / floor)
        if full > 1.0:
            mix, fair = clamp(values["MOT_STR_THR_MIX"], 0.0, 1.0), 1.0 / full
            if mix >= 0.5:
                steering *= fair + (1.0 - fair) * (mix - 0.5) / 0.5
                throttle = 1.0 - abs(steering) if throttle >= best else abs(steering) + floor
            else:
                throttle *= 1.0 + (fair - 1.0) * mix / 0.5
                room = 1.0 - throttle if throttle >= best else throttle - floor
                steering = math.copysign(room, steering)
        if abs(steering) < abs(self.steering) or abs(self.steering) >= 1.0:
            self.limit_left, self.limit_right = self.steering < 0.0, self.steering > 0.0
        self.limit_throttle = self.limit_throttle or abs(throttle) < abs(self.throttle / 100.0)
        left, right = throttle + steering, throttle - steering
        self._left, self._right = (m * asymmetry if m < 0.0 else m for m in (left, right))

    def _pulse(self, function: int, low: int, trim: int, high: int, sign: int) -> int:
        if function == _STEERING:
            value = sign * self._servo
        elif function == _THROTTLE:
            value = sign * self._shape(clamp(self.throttle / 100.0 / max(self._turned, 1e-3), -1.0, 1.0))
        elif function in (_LEFT, _RIGHT):
            value = sign * self._shape(self._left if function == _LEFT else self._right)
        else:
            return trim
        span = high - trim if value > 0.0 else trim - low
        return trim + int(value * span + math.copysign(_ROUNDING, value))

    def _shape(self, throttle: float) -> float:
        """Return the pulse [-1, 1] for a throttle [-1, 1]: raised above MOT_THR_MIN, then curved by MOT_THST_EXPO."""
        values = self._values
        if throttle == 0.0:
            return 0.0
        floor, expo = clamp(values["MOT_THR_MIN"], 0.0, _MOST_FLOOR) / 100.0, values["MOT_THST_EXPO"]
        size = floor + abs(throttle) * (1.0 - floor)
        if expo != 0.0 and -1.0 <= expo <= 1.0:
            size = min(size, 1.0)
            size = ((expo - 1.0) + math.sqrt(max((1.0 - expo) ** 2 + 4.0 * expo * size, 0.0))) / (2.0 * expo)
        return math.copysign(min(size, 1.0), throttle)
