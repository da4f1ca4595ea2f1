"""Laws on the horizontal plane that both firmwares share. Vectors are complex numbers, north + i east.

Sources: ArduPilot's ``libraries/AP_Math/control`` and ``libraries/AC_PID`` (``AC_P_2D``, ``AC_PID_2D``).
"""

from __future__ import annotations

import cmath
import math

from sitl.autopilot.parameters import ParameterStore
from sitl.autopilot.scurve import Motion
from sitl.autopilot.shaping import clamp, invert_sqrt_controller, low_pass_share, sqrt_controller

__all__ = ["PlanePid", "PositionP", "clip", "dot", "shape_position", "shape_velocity", "to_body", "to_earth", "unit"]

_ACROSS = 1.0 / math.sqrt(2.0)
"""Share of the acceleration that stays available across the track, so that corners do not overshoot."""


def dot(a: complex, b: complex) -> float:
    """Return the scalar product of two vectors."""
    return a.real * b.real + a.imag * b.imag


def unit(vector: complex) -> complex:
    """Return *vector* with length 1; 0 stays 0."""
    size = abs(vector)
    return vector / size if size > 0.0 else 0j


def clip(vector: complex, length: float) -> complex:
    """Return *vector*, shortened to *length* where it is longer."""
    size = abs(vector)
    return vector * (length / size) if size > length else vector


def to_earth(vector: complex, yaw: float) -> complex:
    """Turn a vector from body axes (ahead + i starboard) to north + i east; *yaw* in rad."""
    return vector * cmath.rect(1.0, yaw)


def to_body(vector: complex, yaw: float) -> complex:
    """Turn a vector from north + i east to body axes (ahead + i starboard); *yaw* in rad."""
    return vector * cmath.rect(1.0, -yaw)


def _sqrt_vector(error: complex, p: float, limit: float, dt: float) -> complex:
    size = abs(error)
    return error * (sqrt_controller(size, p, limit, dt) / size) if size > 0.0 else 0j


class PositionP:
    """Position error to velocity: ``P e``, and the square root where *acceleration* could not brake otherwise.

    The error is cut to what the greatest *speed* can use. The limits hold from :meth:`limit` on, with the gain of that
    moment, as in the firmware.
    """

    def __init__(self, parameters: ParameterStore, name: str) -> None:
        self._values, self._name = parameters.values, name
        self._acceleration = self._most = 0.0

    @property
    def gain(self) -> float:
        """P [1/s]."""
        return self._values[self._name]

    def limit(self, speed: float, acceleration: float, jerk: float = 0.0) -> None:
        """Set the limits [m/s, m/s^2, m/s^3]; 0 is none."""
        p = self.gain
        if jerk > 0.0 and p > 0.0:
            acceleration = min(acceleration, jerk / p)
        self._acceleration = acceleration
        self._most = 0.0
        if speed > 0.0 and p > 0.0:
            self._most = invert_sqrt_controller(speed, p, acceleration) if acceleration > 0.0 else speed / p

    def update(self, target: complex, place: complex) -> tuple[complex, complex]:
        """Return the velocity that corrects the position, and the target as the cut error leaves it."""
        error = target - place
        if self._most > 0.0 and abs(error) > self._most:
            error = clip(error, self._most)
            target = place + error
        return _sqrt_vector(error, self.gain, self._acceleration, 0.0), target


class PlanePid:
    """PID and feed-forward on velocities: ``P e + I int(e) + D LPF(de/dt) + FF v_target``.

    ``e = LPF(v_target - v)`` with FLTE; the length of the integral stays within IMAX. While the craft is *limited* in a
    direction, the integral does not grow in it. Gains are read live.
    """

    def __init__(self, parameters: ParameterStore, prefix: str) -> None:
        self._values = parameters.values
        self._names = tuple(f"{prefix}_{name}" for name in ("P", "I", "D", "FF", "IMAX", "FLTE", "FLTD"))
        self.integrator = 0j
        self._error = self._slope = 0j
        self._fresh = True

    def reset_filters(self) -> None:
        """Start the filters at the next error."""
        self._fresh = True

    def update(self, target: complex, velocity: complex, dt: float, limited: complex = 0j) -> complex:
        """Return the acceleration for a *target* velocity."""
        p, i, d, ff, most, error_cutoff, slope_cutoff = (self._values[name] for name in self._names)
        error = target - velocity
        if self._fresh:
            self._fresh, self._error, self._slope = False, error, 0j
        else:
            last = self._error
            self._error += low_pass_share(error_cutoff, dt) * (error - last)
            self._slope += low_pass_share(slope_cutoff, dt) * ((self._error - last) / dt - self._slope)
        step = i * dt * self._error
        before = abs(self.integrator)
        self.integrator += step
        if dot(step, limited) > 0.0:
            self.integrator = clip(self.integrator, before)
        self.integrator = clip(self.integrator, most)
        return p * self._error + self.integrator + d * self._slope + ff * target


def shape_velocity(wanted: complex, now: Motion, acceleration: float, jerk: float, dt: float) -> None:
    """Move the acceleration of *now* towards what brings its velocity to *wanted* [m/s], with limited jerk.

    Across *wanted* the share :data:`_ACROSS` of *acceleration* [m/s^2] stays available.
    """
    change = _sqrt_vector(wanted - now.velocity, jerk / acceleration, jerk, dt)
    if wanted == 0j:
        change = clip(change, acceleration)
    else:
        along = unit(wanted)
        ahead = dot(along, change)
        across = change - ahead * along
        if abs(ahead) <= abs(across):
            change = clip(change, acceleration)
        else:
            across = clip(across, _ACROSS * acceleration)
            most = math.sqrt(max(acceleration**2 - abs(across) ** 2, 0.0))
            change = across + clamp(ahead, -most, most) * along
    now.acceleration += clip(change - now.acceleration, jerk * dt)


def shape_position(target: Motion, now: Motion, limits: tuple[float, float, float], dt: float) -> None:
    """Advance *now* by *dt* [s] and pull it towards *target*: *limits* are speed, acceleration and jerk (SI).

    Half the acceleration is left for braking, so that a corner does not overshoot the place.
    """
    speed, acceleration, jerk = limits
    now.place += dt * (now.velocity + 0.5 * dt * now.acceleration)
    now.velocity += dt * now.acceleration
    wanted = _sqrt_vector(target.place - now.place, 0.5 * jerk / acceleration, 0.5 * acceleration, dt)
    if speed > 0.0:
        wanted = clip(wanted, speed)
    shape_velocity(wanted + target.velocity, now, acceleration, jerk, dt)
