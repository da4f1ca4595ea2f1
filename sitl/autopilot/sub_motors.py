"""Sub's mixer: converts demands in yaw, forward, lateral, throttle, roll and pitch to thruster pulses."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from sitl.autopilot.parameters import ParameterStore
from sitl.autopilot.servo_rail import ServoRail
from sitl.autopilot.shaping import clamp, low_pass_share

__all__ = ["SubMotors"]

_PLANE = ((1, -1, 1, 0, 0, 0), (-1, -1, -1, 0, 0, 0), (-1, 1, 1, 0, 0, 0), (1, 1, -1, 0, 0, 0))
_PAIR = ((-1, 1, 0, 0, 0, 0), (1, 1, 0, 0, 0, 0))
_SIDE = (0, 0, 1, 0, 0, 0)


def _upright(throttle: float, roll: float = 0.0, pitch: float = 0.0) -> tuple[float, ...]:
    return 0, 0, 0, throttle, roll, pitch


_FRAMES: Mapping[int, Sequence[Sequence[float]]] = {
    0: (*_PAIR, _upright(0.45, -0.5, 0.5), _upright(0.45, 0.5, 0.5), _upright(1, 0, -1), (0, 0, 1, 0, -0.25, 0)),
    1: (*_PLANE, _upright(-1, 1), _upright(-1, -1)),
    2: (*_PLANE, _upright(-1, 1, -1), _upright(-1, -1, -1), _upright(-1, 1, 1), _upright(-1, -1, 1)),
    3: (
        *(_upright(1, 1, 1), (1, 1, 0, 0, 0, 0), _upright(1, 1, -1), _SIDE, _SIDE),
        *(_upright(1, -1, 1), (-1, 1, 0, 0, 0, 0), _upright(1, -1, -1)),
    ),
    4: (*_PAIR, _upright(-1)),
    5: (*_PAIR, _upright(-1, 1), _upright(-1, -1), _SIDE),
    6: (*_PAIR, _upright(-1, 1), _upright(-1, -1), _SIDE),
    7: (*_PAIR, _upright(-1)),
}
"""FRAME_CONFIG -> each motor's (yaw, forward, lateral, throttle, roll, pitch) factors: 0 BlueROV1, 1 vectored, 2
vectored 6-DOF, 3 vectored 6-DOF at right angles, 4 to 6 SimpleROV-3 to -5, 7 custom."""
_FIRST_MOTOR_FUNCTION = 33
_SPAN_PWM = 400.0
_NEUTRAL_PWM = 1500
_ROUNDING = 1e-6
"""Tolerance for pulses, which are truncated to whole microseconds. It keeps an exact stick value exact."""


class SubMotors:
    """Demands as fractions: ``yaw``, ``forward``, ``lateral``, ``roll``, ``pitch`` -1..1; ``throttle`` 0..1, where 0.5
    is neutral and 1 is full up.

    ``throttle_in`` is the demand before the low-pass, ``throttle`` after it.
    """

    def __init__(self, parameters: ParameterStore, dt: float) -> None:
        self._parameters = parameters
        self._version = -1
        self._motors: list[tuple[float, ...]] = []
        self._which: list[int] = []
        self._lowest, self._highest = 0, 0
        self._dt = dt
        self.yaw = self.forward = self.lateral = self.roll = self.pitch = 0.0
        self.throttle_in = self.throttle = 0.5
        self._cutoff = 0.0
        self._written = (math.nan,) * 6

    @property
    def limit_yaw(self) -> bool:
        """Whether the yaw demand is at its limit."""
        return abs(self.yaw) >= 1.0

    @property
    def limit_throttle(self) -> bool:
        """Whether the throttle demand is at 0 or 1."""
        return not 0.0 < self.throttle_in < 1.0

    def set_throttle(self, value: float, cutoff: float) -> None:
        """Set the throttle demand, 0..1, low-passed at *cutoff* [Hz]; 0: no filter."""
        self.throttle_in = clamp(value, 0.0, 1.0)
        self._cutoff = cutoff

    def stop(self) -> None:
        """Clear all demands."""
        self.yaw = self.forward = self.lateral = self.roll = self.pitch = 0.0
        self.throttle_in = self.throttle = 0.5

    def output(self, rail: ServoRail, *, armed: bool) -> None:
        """Write the mixed demands to the thrusters' servo pulses."""
        if not armed:
            self.stop()
        self.throttle += low_pass_share(self._cutoff, self._dt) * (self.throttle_in - self.throttle)
        up = 2.0 * self.throttle - 1.0
        self.yaw = clamp(self.yaw, -1.0, 1.0)
        demands = self.yaw, self.forward, self.lateral, up, self.roll, self.pitch
        if self._version != self._parameters.version:
            self._read_frame()
        elif demands == self._written and not rail.is_overridden:
            return
        self._written = demands
        distinct = self._pulses_of(*demands)
        rail.write_motors([distinct[k] for k in self._which], _FIRST_MOTOR_FUNCTION)

    def _read_frame(self) -> None:
        values = self._parameters.values
        self._version = self._parameters.version
        self._lowest, self._highest = int(values["MOT_PWM_MIN"]), int(values["MOT_PWM_MAX"])
        motors = [
            (not any(factors[3:]), *factors, -_SPAN_PWM if values[f"MOT_{n}_DIRECTION"] < 0.0 else _SPAN_PWM)
            for n, factors in enumerate(_FRAMES.get(int(values["FRAME_CONFIG"]), ()), start=1)
        ]
        self._motors = list(dict.fromkeys(motors))
        self._which = [self._motors.index(motor) for motor in motors]

    def _pulses_of(self, yaw: float, ahead: float, side: float, up: float, roll: float, pitch: float) -> list[int]:
        """Return the pulse [us] of each distinct motor."""
        is_tilted, low, high, pulses = roll or pitch, self._lowest, self._highest, []
        for is_level, by_yaw, by_ahead, by_side, by_up, by_roll, by_pitch, span in self._motors:
            if is_level:  # a motor that neither lifts nor tilts
                output = yaw * by_yaw + ahead * by_ahead + side * by_side
            else:
                output = yaw * by_yaw + ahead * by_ahead + side * by_side + up * by_up
                if is_tilted:
                    output += roll * by_roll + pitch * by_pitch
            output = 1.0 if output > 1.0 else -1.0 if output < -1.0 else output
            pulse = int(_NEUTRAL_PWM + span * output + _ROUNDING)
            pulses.append(low if pulse < low else high if pulse > high else pulse)
        return pulses
