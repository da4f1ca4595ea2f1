"""Rover's way to a place: S-curve legs with rounded corners, pivot turns, or a target that may jump.

Source: ArduPilot's ``libraries/AR_WPNav`` (``AR_WPNav``, ``AR_PivotTurn``). Places are complex numbers, north + i east
[m] of the origin.
"""

from __future__ import annotations

import cmath
import math

from sitl.autopilot.autopilot import StateEstimate
from sitl.autopilot.parameters import ParameterStore
from sitl.autopilot.plane import dot, unit
from sitl.autopilot.rover_loops import RoverSpeedController, RoverSteering
from sitl.autopilot.rover_position import RoverPositionController
from sitl.autopilot.scurve import Limits, SCurve, advance_along
from sitl.autopilot.shaping import clamp, wrap_pi

__all__ = ["PivotTurn", "RoverWaypoints", "stopping_place"]

_STALE_MS = 100
_SNAP = 15.0
"""m/s^4, of the S-curve; fixed in the firmware."""
_SLOWEST = 0.05
"""m/s, the lowest speed limit; fixed in the firmware."""
_ANY_ACCELERATION = 20.0
"""m/s^2, where ATC_ACCEL_MAX sets no limit."""
_CHANGE_MS = 500
"""A new speed limit is taken at most that often."""
_MARGIN = 0.05
"""Share of the target's speed that the track may run ahead of the boat."""


def stopping_place(estimate: StateEstimate, speed_loop: RoverSpeedController) -> complex:
    """Return where the boat comes to rest with its greatest deceleration: ``V^2/(2 a)`` ahead of its course."""
    brake, velocity = speed_loop.deceleration(), estimate.velocity
    return estimate.place + (0.5 * abs(velocity) / brake * velocity if brake > 0.0 else 0j)


class PivotTurn:
    """A turn on the spot of a boat with two thrusters, where the heading is off by more than WP_PIVOT_ANGLE.

    It ends within 5 degrees of the heading, after WP_PIVOT_DELAY.
    """

    _CLOSE = math.radians(5.0)
    _LONGEST_DELAY = 60.0

    def __init__(self, parameters: ParameterStore) -> None:
        self._values = parameters.values
        self.possible = False
        self._active = False
        self._close_since_ms = -1

    @property
    def active(self) -> bool:
        """Whether the boat is to pivot."""
        return self.possible and self._active

    def stop(self) -> None:
        """Drive on."""
        self._active = False

    def needed_for(self, change: float) -> bool:
        """Return whether a *change* of heading [rad] needs a pivot turn."""
        return self._usable and abs(wrap_pi(change)) > math.radians(self._values["WP_PIVOT_ANGLE"])

    def check(self, ms: int, error: float, *, start: bool = False) -> None:
        """Start or end the turn for a heading *error* [rad]; *start* it whatever the error."""
        if not self._usable:
            self._active = False
        elif start or self.needed_for(error):
            self._active, self._close_since_ms = True, -1
        elif self._active:
            if self._close_since_ms < 0 and abs(error) < self._CLOSE:
                self._close_since_ms = ms
            delay = clamp(self._values["WP_PIVOT_DELAY"], 0.0, self._LONGEST_DELAY)
            if 0 <= self._close_since_ms <= ms - 1000.0 * delay:
                self._active = False

    @property
    def _usable(self) -> bool:
        return self.possible and math.radians(self._values["WP_PIVOT_ANGLE"]) > self._CLOSE


class RoverWaypoints:
    """Drives to a destination; ``speed`` [m/s] and ``turn_rate`` [rad/s] are what the inner loops shall do.

    ``reached``: a corner counts once the target has passed it; a last destination also needs the boat within WP_RADIUS
    or past the line abeam of it. ``blends``: the boat does not stop there.
    """

    def __init__(
        self, parameters: ParameterStore, estimate: StateEstimate, steering: RoverSteering, speed: RoverSpeedController
    ) -> None:
        self._values = parameters.values
        self._estimate, self._steering, self._speed_loop = estimate, steering, speed
        self.position = RoverPositionController(parameters, estimate, steering, speed)
        self.pivot = PivotTurn(parameters)
        self.speed_limit = 0.0
        self.nudge = 0.0
        self.speed = self.turn_rate = 0.0
        self.origin = self.destination = 0j
        self.reached = False
        self.blends = False
        self.cross_track = 0.0
        self._heading = 0.0
        self._pivots_next = False
        self._follows = False
        self._legs = SCurve(), SCurve(), SCurve()
        self._pace = 1.0
        self._turn_radius = 0.0
        self._last_ms = self._changed_ms = -_STALE_MS

    # -- what is shown

    @property
    def distance(self) -> float:
        """Metres to the destination."""
        return abs(self.destination - self._estimate.place)

    @property
    def bearing(self) -> float:
        """Direction of the destination [rad]."""
        return cmath.phase(self.destination - self._estimate.place)

    @property
    def wanted_heading(self) -> float:
        """The heading of the last pivot turn [rad]."""
        return self._heading

    # -- orders

    def start(self, speed: float = 0.0) -> None:
        """Forget the way; drive at *speed* [m/s] from now on (0: WP_SPEED)."""
        values = self._values
        self.speed_limit = max(speed if speed > 0.0 else values["WP_SPEED"], _SLOWEST)
        acceleration = min(values["ATC_ACCEL_MAX"], self._speed_loop.deceleration()) or _ANY_ACCELERATION
        if values["WP_ACCEL"] > 0.0:
            acceleration = min(values["WP_ACCEL"], acceleration)
        jerk = values["WP_JERK"] if values["WP_JERK"] > 0.0 else acceleration
        self.position.set_limits(Limits(self.speed_limit, acceleration, jerk, _SNAP))
        self._legs = SCurve(), SCurve(), SCurve()
        self._pace = 1.0
        self.reached = self.blends = self._pivots_next = False
        self.pivot.stop()
        self._stop_here()
        self.nudge = 0.0

    def set_turning(self, radius: float, *, pivots: bool) -> None:
        """Take TURN_RADIUS [m] and whether the boat can pivot (then it has no turning radius)."""
        self._turn_radius = self.position.turn_radius = 0.0 if pivots else radius
        self.pivot.possible = pivots

    def set_speed(self, speed: float) -> bool:
        """Drive at *speed* [m/s] from now on; return whether that is possible."""
        if speed < _SLOWEST:
            return False
        self.speed_limit = speed
        return True

    def go(self, ms: int, destination: complex, next_destination: complex | None = None) -> None:
        """Drive on to *destination*; with *next_destination* round the corner there instead of stopping."""
        if not self._is_active(ms) or not self.reached or self._follows:
            self._stop_here()
            self._legs = SCurve(), SCurve(), SCurve()
        _, this, next_ = self._legs
        limits = self.position.limits
        self.origin, self.destination, self.reached = self.destination, destination, False
        if not self.blends:
            self.pivot.stop()
            self.pivot.check(ms, self._heading_error, start=self._pivots_next)
        shifted = self.blends and not next_.finished
        leg = next_ if shifted else SCurve(self.origin, destination, limits)
        after = SCurve()
        self.blends = self._pivots_next = False
        if next_destination is not None:
            change = _bearing(destination, next_destination) - _bearing(self.origin, destination)
            self._pivots_next = self.pivot.needed_for(change)
            if not self._pivots_next:
                after = SCurve(destination, next_destination, limits)
                self.blends = True
        self._legs = this, leg, after
        self._follows = False

    def follow(self, ms: int, destination: complex) -> None:
        """Drive to a *destination* that may be changed often: no leg, the target is shaped from where it is."""
        if not self._is_active(ms) or not self._follows:
            self._stop_here()
        self.origin, self.destination, self.reached = self.destination, destination, False
        self.pivot.check(ms, self._heading_error)
        self._follows = True

    # -- every loop

    def update(self, ms: int, dt: float) -> None:
        """Move the target on and set :attr:`speed` and :attr:`turn_rate`."""
        self._last_ms = ms
        self._take_speed_limit(ms)
        if not self.pivot.active:
            if self._follows:
                self._advance_shaped(ms, dt)
            else:
                self._advance_on_leg(ms, dt)
        self.cross_track = self._cross_track()
        self.position.update(ms, dt)
        if not self.pivot.active:
            self.speed, self.turn_rate = self.position.speed, self.position.turn_rate
            return
        self.speed = self._speed_loop.limited(ms, 0.0)
        self._heading = self.bearing
        self.turn_rate = 0.0
        if self.speed == 0.0:
            error = self._heading_error
            self.turn_rate = self._steering.rate_for_heading(error, math.radians(self._values["WP_PIVOT_RATE"]))
            self.pivot.check(ms, error)

    def _advance_on_leg(self, ms: int, dt: float) -> None:
        position, limits = self.position, self.position.limits
        pace, velocity = 1.0, position.target.velocity
        if velocity != 0j:
            along = unit(velocity)
            ahead = dot(position.error(ms), along)
            made_good = dot(self._estimate.velocity, along) - position.gain * ahead
            pace = clamp(_MARGIN + made_good / abs(velocity), 0.0, 1.0)
        lag = limits.acceleration / limits.jerk if limits.jerk > 0.0 else 1.0
        self._pace += (pace - self._pace) * dt / lag
        corner = max(self._values["WP_RADIUS"], self._turn_radius), position.lateral_limit
        position.start(ms)
        motion, done = advance_along(self._legs, self.origin, self._pace * dt, corner, blend=self.blends)
        position.target = motion
        if done and not self.reached:
            self.reached = self.blends or self._is_there()

    def _advance_shaped(self, ms: int, dt: float) -> None:
        position = self.position
        position.start(ms)
        position.approach(self.destination, dt)
        if not self.reached:
            settled = abs(self.destination - position.target.place) < 0.01
            self.reached = settled and abs(position.error(ms)) < self._values["WP_RADIUS"]

    def _is_there(self) -> bool:
        track, gone = self.destination - self.origin, self._estimate.place - self.origin
        past = abs(track) ** 2 < 0.001 or dot(track, gone) >= abs(track) ** 2
        return past or self.distance <= self._values["WP_RADIUS"]

    def _take_speed_limit(self, ms: int) -> None:
        speed, limits = max(self.speed_limit, self.nudge), self.position.limits
        if speed == limits.speed or ms - self._changed_ms < _CHANGE_MS:
            return
        self._changed_ms = ms
        self.position.set_limits(Limits(speed, limits.acceleration, limits.jerk, limits.snap))
        for leg in self._legs[1:]:
            leg.set_speed(speed)

    def _cross_track(self) -> float:
        """Return the distance from the line of the leg [m], positive to port of it, as the firmware reports it."""
        track, gone = self.destination - self.origin, self._estimate.place - self.origin
        if abs(track) < 1e-6:
            return self.distance
        return -(unit(track).conjugate() * gone).imag

    @property
    def _heading_error(self) -> float:
        return wrap_pi(self.bearing - self._estimate.yaw)

    def _is_active(self, ms: int) -> bool:
        return ms - self._last_ms < _STALE_MS

    def _stop_here(self) -> None:
        self.origin = self.destination = stopping_place(self._estimate, self._speed_loop)


def _bearing(a: complex, b: complex) -> float:
    """Return the direction from *a* to *b* [rad]; east between equal places, as in the firmware."""
    return cmath.phase(b - a) if a != b else 0.5 * math.pi
