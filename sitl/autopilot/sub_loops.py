"""Sub's inner loops.

Yaw, roll and pitch (as AC_AttitudeControl does): shaped target angle, square-root law of the angle, rate PID. Depth (as
AC_PosControl does, cm inside): position -> climb rate -> acceleration -> throttle.
"""

from __future__ import annotations

import math
from math import remainder, tau

from sitl.autopilot.parameters import ParameterStore
from sitl.autopilot.pid import Pid
from sitl.autopilot.shaping import clamp, invert_sqrt_controller, sqrt_controller, step_towards

__all__ = ["SubAngleController", "SubDepthController"]

_LEAST_ACCELERATION, _MOST_ACCELERATION = math.radians(10.0), math.radians(120.0)
"""Bounds of the square-root controller's deceleration [rad/s^2], fixed in the firmware."""


class SubAngleController:
    """Holds or turns the heading, or holds roll or pitch: *axis* is the part ``YAW``, ``RLL`` or ``PIT`` of its names.

    Angles are in radians; the output is a fraction of full output of the axis. ATC_RAT_YAW_FF has no effect.
    """

    def __init__(self, parameters: ParameterStore, dt: float, axis: str = "YAW") -> None:
        self._parameters, self._version = parameters, -1
        self._dt = dt
        self.pid = Pid(parameters, f"ATC_RAT_{axis}")
        letter = axis[0]
        self._names = f"ATC_ANG_{axis}_P", f"ATC_ACCEL_{letter}_MAX", f"ATC_RATE_{letter}_MAX", f"ATC_SLEW_{axis}"
        self._p = self._most = self._limit = self._top = self._slew = self._quickness = 0.0
        self._is_shaped = False
        self._target = 0.0
        self._target_rate = 0.0

    def reset(self, angle: float) -> None:
        """Reset the loop, with the present *angle* [rad] as target."""
        self.pid.reset()
        self._target = angle
        self._target_rate = 0.0

    def hold(self, angle: float) -> None:
        """Move the target towards *angle* [rad], shaped by ATC_INPUT_TC, ATC_ACCEL_*_MAX and, in yaw, ATC_SLEW_YAW."""
        if self._version != self._parameters.version:
            self._read_gains()
        error = remainder(angle - self._target, tau)
        if not self._is_shaped:
            self._target, self._target_rate = angle, 0.0
            return
        if error == 0.0 == self._target_rate:
            return
        self._approach_rate(sqrt_controller(error, self._quickness, self._most, self._dt))
        if self._slew > 0.0:
            self._target_rate = clamp(self._target_rate, -self._slew, self._slew)

    def turn(self, rate: float) -> None:
        """Turn the target heading at *rate* [rad/s]."""
        if self._version != self._parameters.version:
            self._read_gains()
        self._approach_rate(rate)

    def run(self, angle: float, rate: float, limited: bool) -> float:
        """Return the output (-1 to 1) for the measured *angle* [rad] and *rate* [rad/s]."""
        if self._version != self._parameters.version:
            self._read_gains()
        p, dt, top = self._p, self._dt, self._top
        self._target = remainder(self._target + self._target_rate * dt, tau)
        error = remainder(self._target - angle, tau)
        if p > 0.0 and abs(error) > _MOST_ACCELERATION / p:
            error = math.copysign(_MOST_ACCELERATION / p, error)
            self._target = remainder(angle + error, tau)
        wanted = sqrt_controller(error, p, self._limit, dt) + self._target_rate
        if top > 0.0:
            wanted = -top if wanted < -top else top if wanted > top else wanted
        output = self.pid.update(wanted, rate, dt, limited)
        return -1.0 if output < -1.0 else 1.0 if output > 1.0 else output

    def _read_gains(self) -> None:
        values, (p, most, top, slew) = self._parameters.values, self._names
        self._version = self._parameters.version
        self._p, self._most = values[p], math.radians(values[most] / 100.0)
        half = clamp(0.5 * self._most, _LEAST_ACCELERATION, _MOST_ACCELERATION)
        self._limit = half if self._most > 0.0 else 0.0
        self._top, self._slew = math.radians(values[top]), math.radians(values.get(slew, 0.0) / 100.0)
        self._is_shaped, self._quickness = bool(values["ATC_RATE_FF_ENAB"]), 1.0 / max(values["ATC_INPUT_TC"], 0.01)

    def _approach_rate(self, wanted: float) -> None:
        limit = self._most
        self._target_rate = step_towards(self._target_rate, wanted, limit * self._dt) if limit > 0.0 else wanted


_THROTTLE_PER_OUTPUT = 0.001


class SubDepthController:
    """Holds an altitude (cm above the surface, so negative under water) and tracks a climb rate.

    The position error is limited to the amount that the speed limit can use, and the target is moved to that distance.
    So a distant target must be sent repeatedly, as ground stations do. ``target`` is in cm, ``run`` returns a throttle
    of 0..1.
    """

    def __init__(self, parameters: ParameterStore, dt: float) -> None:
        self._values = parameters.values
        self._dt = dt
        self.velocity = Pid(parameters, "PSC_VELZ")
        self.acceleration = Pid(parameters, "PSC_ACCZ")
        self.target = 0.0
        self._wanted_climb = 0.0

    def reset(self, altitude: float, climb: float, throttle: float) -> None:
        """Reset for a smooth start at *altitude* [cm] with *climb* [cm/s] and the present *throttle*."""
        self.velocity.reset()
        self.acceleration.reset()
        self.acceleration.integrator = (throttle - self._values["MOT_THST_HOVER"]) / _THROTTLE_PER_OUTPUT
        self.target = altitude
        self._wanted_climb = climb

    def climb(self, rate: float) -> None:
        """Move the target at *rate* [cm/s, up], accelerated with PILOT_ACCEL_Z."""
        values = self._values
        rate = clamp(rate, -self._fastest_down(), values["PILOT_SPEED_UP"])
        self._wanted_climb = step_towards(self._wanted_climb, rate, values["PILOT_ACCEL_Z"] * self._dt)
        self.target += self._wanted_climb * self._dt

    def follow(self, altitude: float, rate: float) -> None:
        """Let the target be at *altitude* [cm] and move at *rate* [cm/s, up]."""
        self.target, self._wanted_climb = altitude, rate

    def run(self, altitude: float, climb: float, acceleration: float, limited: bool) -> float:
        """Return the throttle (0 to 1) for the measured *altitude* [cm], *climb* [cm/s], *acceleration* [cm/s^2], all
        up.
        """
        values, dt = self._values, self._dt
        wanted_climb = self._position_loop(altitude) + self._wanted_climb
        wanted = self.velocity.update(wanted_climb, climb, dt, limited) + self.velocity.feed_forward
        hover = values["MOT_THST_HOVER"]
        self.acceleration.least_imax = hover / _THROTTLE_PER_OUTPUT
        out = self.acceleration.update(wanted, acceleration, dt, limited) + self.acceleration.feed_forward
        return _THROTTLE_PER_OUTPUT * out + hover

    def _position_loop(self, altitude: float) -> float:
        values = self._values
        p, limit = values["PSC_POSZ_P"], values["PILOT_ACCEL_Z"]
        error = self.target - altitude
        if limit > 0.0:
            up = invert_sqrt_controller(values["PILOT_SPEED_UP"], p, limit)
            down = invert_sqrt_controller(self._fastest_down(), p, limit)
            error = clamp(error, -down, up)
            self.target = altitude + error
        return sqrt_controller(error, p, limit, self._dt)

    def _fastest_down(self) -> float:
        return self._values["PILOT_SPEED_DN"] or self._values["PILOT_SPEED_UP"]
