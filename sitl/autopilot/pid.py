"""The PID controller of all firmware loops (structure of ArduPilot's AC_PID)."""

from __future__ import annotations

from sitl.autopilot.parameters import ParameterStore
from sitl.autopilot.shaping import low_pass_share

__all__ = ["Pid"]


class Pid:
    """PID controller with feed-forward, on a filtered target and a filtered error. It reads the gains from the
    parameters on every call.

    ``out = P*e + I*int(e) + D*LPF(de/dt)`` with ``e = LPF_FLTE(LPF_FLTT(target) - measured)``; ``|I| <= IMAX``, ``|P+D|
    <= PDMX`` when that is positive. Feed-forward is stored separately in ``feed_forward``. The SMAX slew-rate limiter
    is off by default and is not simulated. The last values of all terms remain available for PID_TUNING. A velocity
    loop (AC_PID_Basic) has no D_FF, FLTT and PDMX, which then have no effect.
    """

    def __init__(self, parameters: ParameterStore, prefix: str) -> None:
        self._parameters, self._version, self._dt = parameters, -1, 0.0
        names = ("P", "I", "D", "FF", "D_FF", "IMAX", "FLTT", "FLTE", "FLTD", "PDMX")
        self._p, self._i, self._d, self._ff, self._dff, *rest = (f"{prefix}_{name}" for name in names)
        self._imax, self._fltt, self._flte, self._fltd, self._pdmx = rest
        self.integrator = 0.0
        self.least_imax = 0.0
        self.target = self.measured = 0.0
        self.p_part = self.d_part = self.feed_forward = 0.0
        self._error = self._derivative = 0.0
        self._fresh = True
        self._kp = self._ki = self._kd = self._kff = self._kdff = self._most = self._most_pd = 0.0
        self._new_target = self._new_error = self._new_slope = 1.0

    def reset(self) -> None:
        """Clear the integral and restart the filters."""
        self.integrator = 0.0
        self._fresh = True

    def update(self, target: float, measured: float, dt: float, limited: bool) -> float:
        """Return P + I + D, without feed-forward. While *limited* (the actuator is saturated) the magnitude of the
        integral may only decrease.
        """
        if self._version != self._parameters.version or dt != self._dt:
            self._read_gains(dt)
        last = self.target
        if self._fresh:
            self._fresh = False
            self.target = last = wanted = target
            self._error = error = target - measured
            self._derivative = 0.0
        else:
            before = self._error
            self.target = wanted = last + self._new_target * (target - last)
            self._error = error = before + self._new_error * (wanted - measured - before)
            self._derivative += self._new_slope * ((error - before) / dt - self._derivative)
        self.measured = measured
        self.feed_forward = wanted * self._kff + (wanted - last) / dt * self._kdff
        if self._ki == 0.0:
            self.integrator = 0.0
        elif not limited or self.integrator * error < 0.0:
            limit = self._most if self._most > self.least_imax else self.least_imax
            integral = self.integrator + error * self._ki * dt
            self.integrator = -limit if integral < -limit else limit if integral > limit else integral
        self.p_part = p_part = error * self._kp
        self.d_part = d_part = self._derivative * self._kd
        if self._most_pd > 0.0:
            self._limit_p_and_d(self._most_pd)
            p_part, d_part = self.p_part, self.d_part
        return p_part + self.integrator + d_part

    def _read_gains(self, dt: float) -> None:
        values = self._parameters.values
        self._version, self._dt = self._parameters.version, dt
        self._kp, self._ki, self._kd, self._kff = (values[n] for n in (self._p, self._i, self._d, self._ff))
        self._kdff, self._most_pd = values.get(self._dff, 0.0), values.get(self._pdmx, 0.0)
        self._most = values[self._imax]
        self._new_target = low_pass_share(values.get(self._fltt, 0.0), dt)
        self._new_error = low_pass_share(values[self._flte], dt)
        self._new_slope = low_pass_share(values[self._fltd], dt)

    def _limit_p_and_d(self, limit: float) -> None:
        size = abs(self.p_part + self.d_part)
        if limit < size:
            self.p_part *= limit / size
            self.d_part *= limit / size
