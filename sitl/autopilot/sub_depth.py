"""Sub's depth cascade: position -> climb rate -> acceleration -> throttle (as AC_PosControl does, cm inside)."""

from __future__ import annotations

from sitl.autopilot.parameters import ParameterStore
from sitl.autopilot.pid import Pid
from sitl.autopilot.shaping import clamp, invert_sqrt_controller, sqrt_controller, step_towards

__all__ = ["SubDepthController"]

_THROTTLE_PER_OUTPUT = 0.001


class SubDepthController:
    """Holds an altitude (cm, up from the surface: negative under water) and follows a climb rate.

    The position error is cut to what the speed limit can use, and the *target moves with it*: a far target must be
    sent again and again, as ground stations do. ``target`` is in cm, ``run`` returns a throttle of 0..1.
    """

    def __init__(self, parameters: ParameterStore, dt: float) -> None:
        self._values = parameters.values
        self._dt = dt
        self.velocity = Pid(parameters, "PSC_VELZ")
        self.acceleration = Pid(parameters, "PSC_ACCZ")
        self.target = 0.0
        self._wanted_climb = 0.0

    def reset(self, altitude: float, climb: float, throttle: float) -> None:
        """Take over smoothly at *altitude* [cm] with *climb* [cm/s] and the present *throttle*."""
        self.velocity.reset()
        self.acceleration.reset()
        self.acceleration.integrator = (throttle - self._values["MOT_THST_HOVER"]) / _THROTTLE_PER_OUTPUT
        self.target = altitude
        self._wanted_climb = climb

    def climb(self, rate: float) -> None:
        """Move the target at *rate* [cm/s, up], reached with PILOT_ACCEL_Z."""
        values = self._values
        rate = clamp(rate, -self._fastest_down(), values["PILOT_SPEED_UP"])
        self._wanted_climb = step_towards(self._wanted_climb, rate, values["PILOT_ACCEL_Z"] * self._dt)
        self.target += self._wanted_climb * self._dt

    def run(self, altitude: float, climb: float, acceleration: float, limited: bool) -> float:
        """Return the throttle for measured *altitude* [cm], *climb* [cm/s], *acceleration* [cm/s^2], all up."""
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
