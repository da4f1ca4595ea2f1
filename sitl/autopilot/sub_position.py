"""Sub's horizontal position: holding a place and going to another one along a straight line, depth included.

Sources: ArduPilot's ``libraries/AC_AttitudeControl/AC_PosControl`` (NE), ``libraries/AC_WPNav`` and ``ArduSub/motors``.
As in the firmware, lengths are in cm; vectors are complex numbers, north + i east.
"""

from __future__ import annotations

import math

from sitl.autopilot.parameters import ParameterStore
from sitl.autopilot.plane import PlanePid, PositionP, clip, dot, shape_position, to_body, unit
from sitl.autopilot.scurve import Limits, Motion, SCurve
from sitl.autopilot.shaping import clamp, invert_sqrt_controller, low_pass_share

__all__ = ["SubPositionController", "SubWaypoint"]

_GRAVITY = 980.665
"""cm/s^2."""
_FULL_THROTTLE = 0.8
"""Throttle at which nothing is left for leaning, fixed in the firmware."""
_LEAST_LEAN = math.radians(10.0)
_LEAN_CUTOFF = 1.0 / math.tau
"""Hz, of the lean limit; fixed in the firmware."""
_USUAL_ACCELERATION = 250.0
"""cm/s^2, where WPNAV_ACCEL is 0."""
_SLOWEST = 10.0
"""cm/s, the lowest WPNAV_SPEED."""
_LEAST_INPUT_TIME = 0.1
"""s, of ATC_INPUT_TC, from which the snap follows."""
_MARGIN = 0.05


class SubPositionController:
    """``v = P e + v_target``, ``a = PID(v) + a_target``; the acceleration becomes thrust as if the craft leaned.

    A lean of ANGLE_MAX is full thrust: ``atan(a/g)/ANGLE_MAX``. Climbing or diving hard leaves less of it.
    """

    def __init__(self, parameters: ParameterStore, dt: float) -> None:
        self._values = parameters.values
        self._dt = dt
        self._position = PositionP(parameters, "PSC_POSXY_P")
        self._velocity = PlanePid(parameters, "PSC_VELXY")
        self.target = self.velocity = self.acceleration = 0j
        self._wanted = self._limited = 0j
        self._most_lean = 0.0

    @property
    def gain(self) -> float:
        """PSC_POSXY_P."""
        return self._position.gain

    @property
    def speed(self) -> float:
        """WPNAV_SPEED [cm/s]."""
        return max(self._values["WPNAV_SPEED"], _SLOWEST)

    @property
    def limit(self) -> float:
        """WPNAV_ACCEL [cm/s^2]."""
        return self._values["WPNAV_ACCEL"] if self._values["WPNAV_ACCEL"] > 0.0 else _USUAL_ACCELERATION

    def start(self, place: complex, velocity: complex) -> None:
        """Forget the past and hold where the craft comes to rest."""
        self._wanted = 0j
        self._position.limit(self.speed, self.limit)
        self.hold(place, velocity)

    def hold(self, place: complex, velocity: complex) -> None:
        """Hold from now on where the craft comes to rest; the present thrust stays."""
        self._velocity.reset_filters()
        self._velocity.integrator = self._wanted - self._values["PSC_VELXY_FF"] * velocity
        speed = min(abs(velocity), self.speed)
        self.target = place + invert_sqrt_controller(speed, self.gain, self.limit) * unit(velocity)
        self.velocity = self.acceleration = 0j

    def begin_shaping(self, place: complex, velocity: complex) -> None:
        """Start the target where the craft is and as fast as it moves; the present thrust stays."""
        self._velocity.reset_filters()
        self._velocity.integrator = self._wanted - self._values["PSC_VELXY_FF"] * velocity
        self.target, self.velocity, self.acceleration = place, velocity, 0j

    def approach(self, goal: complex) -> None:
        """Move the target towards *goal* [cm] with limited speed, acceleration and jerk."""
        now = Motion(self.target, self.velocity, self.acceleration)
        jerk = 100.0 * self._values["PSC_JERK_XY"]
        shape_position(Motion(goal), now, (self.speed, self.limit, jerk), self._dt)
        self.target, self.velocity, self.acceleration = now.place, now.velocity, now.acceleration

    def run(self, place: complex, velocity: complex, yaw: float, throttle: float) -> tuple[float, float]:
        """Return the forward and lateral demand (-1 to 1) at *place* [cm] with *velocity* [cm/s] and *yaw* [rad]."""
        wanted, self.target = self._position.update(self.target, place)
        wanted += self.velocity
        acceleration = self._velocity.update(wanted, velocity, self._dt, self._limited) + self.acceleration
        most = _GRAVITY * math.tan(self._lean_limit(throttle))
        self._wanted = _limit(self.velocity, acceleration, most)
        self._limited = 0j if self._wanted == acceleration else acceleration
        body = to_body(self._wanted, yaw)
        pitch = math.atan(body.real / _GRAVITY)
        roll = math.atan(body.imag * math.cos(pitch) / _GRAVITY)
        full = math.radians(self._values["ANGLE_MAX"] / 100.0)
        return clamp(pitch / full, -1.0, 1.0), clamp(roll / full, -1.0, 1.0)

    def _lean_limit(self, throttle: float) -> float:
        lean = math.acos(clamp(throttle / _FULL_THROTTLE, 0.0, 1.0))
        self._most_lean += low_pass_share(_LEAN_CUTOFF, self._dt) * (lean - self._most_lean)
        return min(max(self._most_lean, _LEAST_LEAN), math.radians(self._values["ANGLE_MAX"] / 100.0))


def _limit(velocity: complex, acceleration: complex, most: float) -> complex:
    """Return *acceleration*, cut to *most*: what is across *velocity* goes first."""
    if abs(acceleration) <= most or velocity == 0j:
        return clip(acceleration, most)
    along = unit(velocity)
    ahead = dot(along, acceleration)
    across = acceleration - ahead * along
    if abs(across) > most:
        return clip(across, most)
    left = math.sqrt(most**2 - abs(across) ** 2)
    return across + clamp(ahead, -left, left) * along


class SubWaypoint:
    """A straight leg in three dimensions, its target waiting for a craft that lags. ``altitude`` is up, cm."""

    def __init__(self, parameters: ParameterStore, controller: SubPositionController, dt: float) -> None:
        self._values = parameters.values
        self._controller, self._dt = controller, dt
        self._leg = SCurve()
        self._pace = 1.0
        self._from = self.destination = 0j
        self._across = 0j
        self._up = 0.0
        self._altitude_from = self.altitude = 0.0
        self.climb = 0.0

    @property
    def active(self) -> bool:
        """Whether there is a leg to fly."""
        return not self._leg.finished

    def stop(self) -> None:
        """Go nowhere."""
        self._leg = SCurve()
        self.destination, self.climb = self._controller.target, 0.0

    def go(self, altitude_now: float, place: complex, altitude: float) -> None:
        """Fly to *place* and *altitude* from the present target and *altitude_now*."""
        self._from, self._altitude_from = self._controller.target, altitude_now
        self.destination = place
        way, rise = place - self._from, altitude - altitude_now
        length = math.hypot(abs(way), rise)
        self._pace = 1.0
        if length == 0.0:
            self.stop()
            return
        self._across, self._up = way / length, rise / length
        fastest_up = self._values["WPNAV_SPEED_UP"] if rise > 0.0 else self._values["WPNAV_SPEED_DN"]
        speed = _share_out(abs(self._across), self._controller.speed, abs(self._up), fastest_up)
        limit = _share_out(abs(self._across), self._controller.limit, abs(self._up), self._values["WPNAV_ACCEL_Z"])
        jerk = 100.0 * (self._values["WPNAV_JERK"] if self._values["WPNAV_JERK"] > 0.0 else limit / 100.0)
        snap = 0.25 * math.pi * jerk / max(self._values["ATC_INPUT_TC"], _LEAST_INPUT_TIME)
        self._leg = SCurve(0j, complex(length, 0.0), Limits(speed, limit, jerk, snap))

    def advance(self, velocity: complex, climb: float, error: complex, rise: float) -> None:
        """Move the target on; *error*, *rise* [cm]: from the craft to it; *velocity*, *climb* [cm/s]: its own."""
        controller, leg = self._controller, self._leg
        acceleration, speed, _ = leg.at(leg.t)
        pace = 1.0
        if speed > 0.0:
            lag = dot(error, self._across) + rise * self._up
            made_good = dot(velocity, self._across) + climb * self._up - controller.gain * lag
            pace = clamp(_MARGIN + made_good / speed, 0.0, 1.0)
        slowness = 0.01 * controller.limit / self._values["WPNAV_JERK"] if self._values["WPNAV_JERK"] > 0.0 else 1.0
        self._pace += (pace - self._pace) * self._dt / slowness
        leg.t = min(leg.t + self._pace * self._dt, leg.end)
        acceleration, speed, leg.distance = leg.at(leg.t)
        controller.target = self._from + leg.distance * self._across
        controller.velocity, controller.acceleration = speed * self._across, acceleration * self._across
        self.altitude, self.climb = self._altitude_from + leg.distance * self._up, speed * self._up
        if leg.finished:
            controller.target = self.destination
            controller.velocity = controller.acceleration = 0j
            self.climb = 0.0


def _share_out(level: float, most_level: float, steep: float, most_steep: float) -> float:
    """Return the limit along a line with the direction cosines *level* and *steep*, each within its own limit."""
    bounds = [most / part for part, most in ((level, most_level), (steep, most_steep)) if part > 0.0]
    return min(bounds)
