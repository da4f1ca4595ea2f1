"""Rover's inner loops.

Steering (AR_AttitudeControl's structure): heading error -> turn rate -> steering output. Speed: acceleration limit,
CRUISE feed-forward, PID, stopping.
"""

from __future__ import annotations

import math

from sitl.autopilot.parameters import ParameterStore
from sitl.autopilot.pid import Pid
from sitl.autopilot.shaping import clamp, step_towards

__all__ = ["RoverSpeedController", "RoverSteering"]

_STALE_MS = 200
_STOPPED_MS = 300
"""A boat that has stopped counts as stopped for so long, whatever the current does to it."""
_GRAVITY = 9.81
_LEAST_RATE = math.radians(1.0)


class RoverSteering:
    """Heading P, then turn-rate FF + PID. Angles in radians, output a fraction of full steering (not clipped).

    ``limited_left`` and ``limited_right``: whether the turn rate cannot be followed to that side.
    """

    def __init__(self, parameters: ParameterStore, dt: float) -> None:
        self._values = parameters.values
        self._dt = dt
        self.pid = Pid(parameters, "ATC_STR_RAT")
        self._wanted = 0.0
        self._last_ms = -_STALE_MS
        self.limited_left = self.limited_right = False

    def rate_for_heading(self, error: float, top: float = 0.0) -> float:
        """Return the demanded turn rate [rad/s] for a heading *error* [rad]; at most *top* (0: no limit)."""
        values = self._values
        rate = values["ATC_STR_ANG_P"] * error
        if top > 0.0:
            rate = clamp(rate, -top, top)
        brake = math.radians(values["ATC_STR_DEC_MAX"] or values["ATC_STR_ACC_MAX"])
        if brake > 0.0:
            top = math.sqrt(2.0 * abs(error) * brake)
            rate = clamp(rate, -top, top)
        return rate

    def run(self, ms: int, wanted: float, measured: float, speed: float, limited: bool) -> float:
        """Return the steering output (fraction of full) for the turn rates *wanted* and *measured* [rad/s], at *speed*
        [m/s].
        """
        values = self._values
        if ms - self._last_ms > _STALE_MS:
            self.pid.reset()
            self._wanted = measured
        self._last_ms = ms
        requested = wanted
        if values["ATC_STR_ACC_MAX"] > 0.0:
            wanted = step_towards(self._wanted, wanted, math.radians(values["ATC_STR_ACC_MAX"]) * self._dt)
        if values["ATC_STR_RAT_MAX"] > 0.0:
            top = math.radians(values["ATC_STR_RAT_MAX"])
            wanted = clamp(wanted, -top, top)
        top = max(self.lateral_acceleration_limit() / max(abs(speed), 1.0), _LEAST_RATE)
        self._wanted = clamp(wanted, -top, top)
        self.limited_left, self.limited_right = self._wanted > requested, self._wanted < requested
        out = self.pid.update(self._wanted, measured, self._dt, limited)
        return out + self.pid.feed_forward

    def lateral_acceleration_limit(self) -> float:
        """Return the limit of lateral acceleration [m/s^2]: ATC_TURN_MAX_G, at least 0.1 g."""
        return max(self._values["ATC_TURN_MAX_G"], 0.1) * _GRAVITY


class RoverSpeedController:
    """Speed [m/s] to throttle -1..1: ``v*CRUISE_THROTTLE/100/CRUISE_SPEED + FF*v + P*e + I*int(e) + D*de/dt``."""

    def __init__(self, parameters: ParameterStore, dt: float) -> None:
        self._values = parameters.values
        self._dt = dt
        self.pid = Pid(parameters, "ATC_SPEED")
        self.feed_forward = 0.0
        self._wanted = 0.0
        self._limited = False
        self._last_ms = -_STALE_MS
        self._stopped_ms = -_STOPPED_MS

    def limited(self, ms: int, wanted: float) -> float:
        """Return *wanted* as far as the acceleration limits allow it in this loop."""
        stale = ms - self._last_ms > _STALE_MS
        return wanted if stale or self._values["ATC_ACCEL_MAX"] <= 0.0 else self._limit_acceleration(wanted)

    def is_stopped(self, ms: int) -> bool:
        """Return whether the boat counts as stopped."""
        return ms - self._stopped_ms < _STOPPED_MS

    def deceleration(self) -> float:
        """Return the greatest deceleration [m/s^2]; 0: none."""
        return self._values["ATC_DECEL_MAX"] if self._values["ATC_DECEL_MAX"] > 0.0 else self._values["ATC_ACCEL_MAX"]

    def run(self, ms: int, wanted: float, speed: float, limited: bool) -> float:
        """Return the throttle for *wanted* at the measured *speed*; a boat once stopped has none until it is to go."""
        if ms - self._last_ms > _STALE_MS:
            self.pid.reset()
            self._wanted = speed
            self._limited = False
        self._last_ms = ms
        self._wanted = wanted = self._limit_acceleration(wanted)
        still = self.is_stopped(ms) or abs(speed) <= self._values["ATC_STOP_SPEED"]
        if wanted == 0.0 and still:
            self._stopped_ms = ms
            self.pid.reset()
            self.feed_forward = 0.0
            return 0.0
        return self._control(wanted, speed, limited)

    def _limit_acceleration(self, wanted: float) -> float:
        values = self._values
        limit = values["ATC_ACCEL_MAX"]
        if abs(wanted) < abs(self._wanted) and values["ATC_DECEL_MAX"] > 0.0:
            limit = values["ATC_DECEL_MAX"]
        if limit > 0.0:
            wanted = step_towards(self._wanted, wanted, limit * self._dt)
        return wanted

    def _control(self, wanted: float, speed: float, limited: bool) -> float:
        values = self._values
        base = 0.0
        if values["CRUISE_SPEED"] > 0.0 and values["CRUISE_THROTTLE"] > 0.0:
            base = wanted * values["CRUISE_THROTTLE"] / 100.0 / values["CRUISE_SPEED"]
        out = self.pid.update(wanted, speed, self._dt, limited or self._limited)
        self.feed_forward = self.pid.feed_forward + base
        out += self.feed_forward
        self._limited = abs(out) > 1.0
        if values["ATC_BRAKE"] == 0.0 and ((wanted >= 0.0 and out <= 0.0) or (wanted <= 0.0 and out >= 0.0)):
            out = 0.0
            self._limited = True
        return clamp(out, -1.0, 1.0)
