"""Rover's position controller: a moving target on the plane to a speed and a turn rate.

Source: ArduPilot's ``libraries/APM_Control/AR_PosControl``. Vectors are complex numbers, north + i east, SI.
"""

from __future__ import annotations

import math

from sitl.autopilot.autopilot import StateEstimate
from sitl.autopilot.parameters import ParameterStore
from sitl.autopilot.plane import PlanePid, PositionP, clip, dot, shape_position, to_body, to_earth
from sitl.autopilot.rover_loops import RoverSpeedController, RoverSteering
from sitl.autopilot.scurve import Limits, Motion

__all__ = ["RoverPositionController"]

_STALE_MS = 100


class RoverPositionController:
    """``v = P e + v_target``, ``a = PID(v) + a_target``; ahead it gives the speed, abeam the turn rate ``a_y/V``.

    The integral is kept across the hull only: ahead, the speed loop has its own. A boat without pivot turns keeps the
    speed ``sqrt(a_lat TURN_RADIUS/2)`` in turns. ``target`` is the moving place; ``speed`` [m/s] and ``turn_rate``
    [rad/s] are the result.
    """

    def __init__(
        self, parameters: ParameterStore, estimate: StateEstimate, steering: RoverSteering, speed: RoverSpeedController
    ) -> None:
        self._values = parameters.values
        self._estimate, self._steering, self._speed_loop = estimate, steering, speed
        self._position = PositionP(parameters, "PSC_POS_P")
        self._velocity = PlanePid(parameters, "PSC_VEL")
        self.limits = Limits(0.0, 0.0, 0.0, 0.0)
        self.lateral_limit = 0.0
        self.turn_radius = 0.0
        self.target = Motion()
        self.speed = self.turn_rate = 0.0
        self._last_ms = -_STALE_MS

    @property
    def gain(self) -> float:
        """PSC_POS_P."""
        return self._position.gain

    @property
    def velocity_integral(self) -> complex:
        """The integral of the velocity loop [m/s^2]."""
        return self._velocity.integrator

    def error(self, ms: int) -> complex:
        """Return the vector to the target [m]; 0 when the controller does not run."""
        return self.target.place - self._estimate.place if self.is_active(ms) else 0j

    def is_active(self, ms: int) -> bool:
        """Return whether it ran within the last 0.1 s."""
        return ms - self._last_ms < _STALE_MS

    def set_limits(self, limits: Limits) -> None:
        """Set the limits along the track; across it, ATC_TURN_MAX_G holds."""
        self.limits = limits
        self.lateral_limit = self._steering.lateral_acceleration_limit()
        self._position.limit(limits.speed, min(limits.acceleration, self.lateral_limit), limits.jerk)

    def start(self, ms: int) -> None:
        """Start the target where the boat is, unless the controller runs already."""
        if not self.is_active(ms):
            self.target = Motion(self._estimate.place, self._estimate.velocity)

    def approach(self, place: complex, dt: float) -> None:
        """Move the target towards *place* with limited speed, acceleration and jerk."""
        acceleration = min(self.limits.acceleration, self.lateral_limit)
        shape_position(Motion(place), self.target, (self.limits.speed, acceleration, self.limits.jerk), dt)

    def update(self, ms: int, dt: float) -> None:
        """Set :attr:`speed` and :attr:`turn_rate` for the present target."""
        estimate = self._estimate
        if not self.is_active(ms):
            self._velocity.integrator = 0j
            self._velocity.reset_filters()
        self._last_ms = ms
        correction, _ = self._position.update(self.target.place, estimate.place)
        wanted = clip(correction + self.target.velocity, self.limits.speed)
        stopping = self.target.velocity == 0j
        acceleration = self._velocity.update(wanted, estimate.velocity, dt, self._limited_side())
        acceleration += self.target.acceleration
        abeam = to_earth(1j, estimate.yaw)
        self._velocity.integrator = dot(self._velocity.integrator, abeam) * abeam
        speed = to_body(wanted, estimate.yaw).real
        if not stopping:
            slowest = math.sqrt(0.5 * self._steering.lateral_acceleration_limit() * self.turn_radius)
            speed = max(min(abs(wanted), slowest), speed)
        self.speed = self._speed_loop.limited(ms, speed)
        lateral = 0.0 if stopping else to_body(acceleration, estimate.yaw).imag
        self.turn_rate = lateral / math.copysign(max(abs(self.speed), 1.0), self.speed)

    def _limited_side(self) -> complex:
        """Return the direction in which the steering is at its limit; 0 when it is not."""
        side = -1j if self._steering.limited_left else 1j if self._steering.limited_right else 0j
        return to_earth(side, self._estimate.yaw)
