"""Sub's mixer: demands in yaw, forward, lateral and throttle to thruster pulses."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from sitl.autopilot.parameters import ParameterStore
from sitl.autopilot.servo_rail import ServoRail
from sitl.autopilot.shaping import clamp, low_pass_share

__all__ = ["SubMotors"]

_PLANE = ((1, -1, 1, 0), (-1, -1, -1, 0), (-1, 1, 1, 0), (1, 1, -1, 0))
_PAIR = ((-1, 1, 0, 0), (1, 1, 0, 0))
_UP, _DOWN, _SIDE = (0, 0, 0, 1), (0, 0, 0, -1), (0, 0, 1, 0)
_FRAMES: Mapping[int, Sequence[tuple[float, float, float, float]]] = {
    0: (*_PAIR, (0, 0, 0, 0.45), (0, 0, 0, 0.45), _UP, _SIDE),
    1: (*_PLANE, _DOWN, _DOWN),
    2: (*_PLANE, _DOWN, _DOWN, _DOWN, _DOWN),
    3: (_UP, (1, 1, 0, 0), _UP, _SIDE, _SIDE, _UP, (-1, 1, 0, 0), _UP),
    4: (*_PAIR, _DOWN),
    5: (*_PAIR, _DOWN, _DOWN, _SIDE),
    6: (*_PAIR, _DOWN, _DOWN, _SIDE),
    7: (*_PAIR, _DOWN),
}
"""FRAME_CONFIG -> each motor's (yaw, forward, lateral, throttle) factors: 0 BlueROV1, 1 vectored, 2 vectored 6-DOF,
3 vectored 6-DOF at right angles, 4 to 6 SimpleROV-3 to -5, 7 custom. Roll and pitch are passive here and have no
factors."""
_FIRST_MOTOR_FUNCTION, _LAST_MOTOR_FUNCTION = 33, 40
_SPAN_PWM = 400
_NEUTRAL_PWM = 1500
_ROUNDING = 1e-6
"""Pulses are cut to whole microseconds; this keeps an exact stick exact."""


class SubMotors:
    """Demands as fractions: ``yaw``, ``forward``, ``lateral`` -1..1; ``throttle`` 0..1 with 0.5 neutral, up more.

    ``throttle_in`` is the demand, ``throttle`` what is left of it behind the low-pass.
    """

    def __init__(self, parameters: ParameterStore, dt: float) -> None:
        self._values = parameters.values
        self._dt = dt
        self.yaw = self.forward = self.lateral = 0.0
        self.throttle_in = self.throttle = 0.5
        self._cutoff = 0.0
        self._outputs: tuple[float, ...] = ()

    @property
    def limit_yaw(self) -> bool:
        """Whether the yaw demand is at its end."""
        return abs(self.yaw) >= 1.0

    @property
    def limit_throttle(self) -> bool:
        """Whether the throttle demand is at either end."""
        return not 0.0 < self.throttle_in < 1.0

    def set_throttle(self, value: float, cutoff: float) -> None:
        """Demand a throttle of 0..1, low-passed at *cutoff* [Hz] (0: not at all)."""
        self.throttle_in = clamp(value, 0.0, 1.0)
        self._cutoff = cutoff

    def stop(self) -> None:
        """Drop every demand."""
        self.yaw = self.forward = self.lateral = 0.0
        self.throttle_in = self.throttle = 0.5

    def output(self, rail: ServoRail, *, armed: bool) -> None:
        """Write the pulses."""
        if not armed:
            self.stop()
        self.throttle += low_pass_share(self._cutoff, self._dt) * (self.throttle_in - self.throttle)
        up = 2.0 * self.throttle - 1.0
        self.yaw = clamp(self.yaw, -1.0, 1.0)
        self._outputs = tuple(
            clamp(self.yaw * yaw + self.forward * ahead + self.lateral * side + up * lift, -1.0, 1.0)
            for yaw, ahead, side, lift in _FRAMES.get(int(self._values["FRAME_CONFIG"]), ())
        )
        rail.write(self._pulse)

    def _pulse(self, function: int, low: int, trim: int, high: int, sign: int) -> int:
        index = function - _FIRST_MOTOR_FUNCTION
        if not _FIRST_MOTOR_FUNCTION <= function <= _LAST_MOTOR_FUNCTION or index >= len(self._outputs):
            return trim
        direction = -1.0 if self._values[f"MOT_{index + 1}_DIRECTION"] < 0.0 else 1.0
        pulse = int(_NEUTRAL_PWM + _SPAN_PWM * direction * self._outputs[index] + _ROUNDING)
        return max(int(self._values["MOT_PWM_MIN"]), min(int(self._values["MOT_PWM_MAX"]), pulse))
