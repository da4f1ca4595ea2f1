"""What steers and drives a boat: the inner loops on its motors, the way to a place, staying at one."""

from __future__ import annotations

import cmath
import math
from collections.abc import Callable

from sitl.autopilot.autopilot import Autopilot
from sitl.autopilot.rover_loops import RoverSpeedController, RoverSteering
from sitl.autopilot.rover_motors import RoverMotors
from sitl.autopilot.rover_waypoints import RoverWaypoints, stopping_place
from sitl.autopilot.shaping import clamp, wrap_pi

__all__ = ["Helm", "Loiter"]

_ALWAYS_AHEAD, _ALWAYS_ASTERN = 1, 2
"""LOIT_TYPE; 0 is the nearer of both."""


class Helm:
    """The boat's loops. *pilot_speed* returns the speed [m/s] that the throttle stick commands."""

    def __init__(
        self,
        owner: Autopilot,
        motors: RoverMotors,
        steering: RoverSteering,
        speed: RoverSpeedController,
        pilot_speed: Callable[[], float],
    ) -> None:
        self._owner = owner
        self.motors, self.steering, self.speed = motors, steering, speed
        self._pilot_speed = pilot_speed
        self.waypoints = RoverWaypoints(owner.parameters, owner.estimate, steering, speed)
        self.loiter = Loiter(owner, self)
        self.read_turning()

    def read_turning(self) -> None:
        """Look up how the boat turns; the firmware does so once a second."""
        self.waypoints.set_turning(self._owner.parameters["TURN_RADIUS"], pivots=self.motors.skid)

    def steer_rate(self, rate: float) -> None:
        """Let the rate loop steer at *rate* [rad/s]."""
        estimate = self._owner.estimate
        out = self.steering.run(self._owner.ms, rate, estimate.yaw_rate, estimate.speed, self.motors.limit_steer)
        self.steering.limited_left |= self.motors.limit_left
        self.steering.limited_right |= self.motors.limit_right
        self.motors.set_steering(out, scaled=True)

    def steer_heading(self, heading: float) -> None:
        """Let the heading loop steer to *heading* [rad]."""
        self.steer_rate(self.steering.rate_for_heading(wrap_pi(heading - self._owner.estimate.yaw)))

    def drive_speed(self, speed: float) -> None:
        """Let the speed loop drive at *speed* [m/s]. Without an estimate of the speed the throttle is zero."""
        if not self._owner.aided:
            self.motors.set_throttle(0.0)
            return
        out = self.speed.run(self._owner.ms, speed, self._owner.estimate.speed, self.motors.limit_throttle)
        self.motors.set_throttle(100.0 * out)

    def stop(self) -> None:
        """Stop without turning; once stopped the boat drifts."""
        self.drive_speed(0.0)
        if self.speed.is_stopped(self._owner.ms):
            self.motors.set_steering(0.0, scaled=True)
        else:
            self.steer_rate(0.0)

    def navigate(self) -> None:
        """Drive on to the destination of :attr:`waypoints`; a throttle stick beyond the speed limit makes it faster."""
        waypoints = self.waypoints
        waypoints.nudge = max(waypoints.speed_limit, self._pilot_speed())
        waypoints.update(self._owner.ms, self._owner.dt)
        self.drive_speed(waypoints.speed)
        self.steer_rate(waypoints.turn_rate)


class Loiter:
    """Stays within LOIT_RADIUS of a place: drifts inside, drives back from outside, ahead or astern.

    Outside the speed is ``LOIT_SPEED_GAIN`` times the distance from the circle, at most WP_SPEED, and less the more the
    bow is off: half at 90 degrees. Source: ArduPilot's ``Rover/mode_loiter``.
    """

    def __init__(self, owner: Autopilot, helm: Helm) -> None:
        self._owner, self._helm = owner, helm
        self.destination = 0j
        self._heading = 0.0

    @property
    def distance(self) -> float:
        """Metres to the place."""
        return abs(self.destination - self._owner.estimate.place)

    @property
    def bearing(self) -> float:
        """Direction of the place [rad]."""
        return cmath.phase(self.destination - self._owner.estimate.place)

    def start(self) -> None:
        """Stay where the boat would come to rest."""
        self.destination = stopping_place(self._owner.estimate, self._helm.speed)
        self._heading = self._owner.estimate.yaw

    def run(self) -> None:
        """Run the heading and speed loops."""
        values, estimate = self._owner.parameters, self._owner.estimate
        beyond = self.distance - values["LOIT_RADIUS"]
        speed = 0.0
        if beyond > 0.0:
            speed = min(beyond * values["LOIT_SPEED_GAIN"], values["WP_SPEED"])
            self._heading = self.bearing
            behind = abs(wrap_pi(self._heading - estimate.yaw)) > 0.5 * math.pi
            way = int(values["LOIT_TYPE"])
            if way == _ALWAYS_ASTERN or (behind and way != _ALWAYS_AHEAD):
                self._heading = wrap_pi(self._heading + math.pi)
                speed = -speed
            off = abs(wrap_pi(self._heading - estimate.yaw)) / (0.5 * math.pi)
            speed *= 1.0 - 0.5 * clamp(off, 0.0, 1.0)
        self._helm.steer_heading(self._heading)
        self._helm.drive_speed(speed)
