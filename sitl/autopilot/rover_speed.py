"""Rover's speed loop: acceleration limit, CRUISE feed-forward, PID, stopping."""

from __future__ import annotations

from sitl.autopilot.parameters import ParameterStore
from sitl.autopilot.pid import Pid
from sitl.autopilot.shaping import clamp, step_towards

__all__ = ["RoverSpeedController"]

_STALE_MS = 200


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

    def run(self, ms: int, wanted: float, speed: float, limited: bool) -> float:
        """Return the throttle for *wanted* at the measured *speed*."""
        if ms - self._last_ms > _STALE_MS:
            self.pid.reset()
            self._wanted = speed
            self._limited = False
        self._last_ms = ms
        wanted = self._limit_acceleration(wanted, speed)
        if wanted == 0.0 and abs(speed) <= self._values["ATC_STOP_SPEED"]:
            self.pid.reset()
            self.feed_forward = 0.0
            return 0.0
        return self._control(wanted, speed, limited)

    def _limit_acceleration(self, wanted: float, speed: float) -> float:
        values = self._values
        limit = values["ATC_ACCEL_MAX"]
        if abs(wanted) < abs(self._wanted) and values["ATC_DECEL_MAX"] > 0.0:
            limit = values["ATC_DECEL_MAX"]
        if limit > 0.0:
            wanted = step_towards(self._wanted, wanted, limit * self._dt)
        self._wanted = wanted
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
