"""The PID block all loops of the firmware share (the structure of ArduPilot's AC_PID)."""

from __future__ import annotations

from sitl.autopilot.parameters import ParameterStore
from sitl.autopilot.shaping import clamp, low_pass_share

__all__ = ["Pid"]


class Pid:
    """P, I, D and feed-forward on a filtered target and a filtered error, gains read live from parameters.

    ``out = P*e + I*int(e) + D*LPF(de/dt)`` with ``e = LPF_FLTE(LPF_FLTT(target) - measured)``; ``|I| <= IMAX``,
    ``|P+D| <= PDMX`` when that is positive. Feed-forward is kept apart in ``feed_forward``. The SMAX slew-rate
    limiter is off at its default and is not simulated. The last parts stay readable for PID_TUNING. A loop on
    velocities (AC_PID_Basic) has no D_FF, FLTT and PDMX, which then do nothing.
    """

    def __init__(self, parameters: ParameterStore, prefix: str) -> None:
        self._values = parameters.values
        names = ("P", "I", "D", "FF", "D_FF", "IMAX", "FLTT", "FLTE", "FLTD", "PDMX")
        self._p, self._i, self._d, self._ff, self._dff, *rest = (f"{prefix}_{name}" for name in names)
        self._imax, self._fltt, self._flte, self._fltd, self._pdmx = rest
        self.integrator = 0.0
        self.least_imax = 0.0
        self.target = self.measured = 0.0
        self.p_part = self.d_part = self.feed_forward = 0.0
        self._error = self._derivative = 0.0
        self._fresh = True

    def reset(self) -> None:
        """Forget the integral and let the filters start anew."""
        self.integrator = 0.0
        self._fresh = True

    def update(self, target: float, measured: float, dt: float, limited: bool) -> float:
        """Return P + I + D. While *limited* (the actuator saturates) the integral may only shrink."""
        values = self._values
        last_error, last_target = self._error, self.target
        if self._fresh:
            self._fresh = False
            self.target = last_target = target
            self._error = target - measured
            self._derivative = 0.0
        else:
            self.target += low_pass_share(values.get(self._fltt, 0.0), dt) * (target - self.target)
            self._error += low_pass_share(values[self._flte], dt) * (self.target - measured - self._error)
            slope = (self._error - last_error) / dt
            self._derivative += low_pass_share(values[self._fltd], dt) * (slope - self._derivative)
        self.measured = measured
        self.feed_forward = self.target * values[self._ff]
        self.feed_forward += (self.target - last_target) / dt * values.get(self._dff, 0.0)
        self._integrate(dt, limited)
        self.p_part = self._error * values[self._p]
        self.d_part = self._derivative * values[self._d]
        self._limit_p_and_d(values.get(self._pdmx, 0.0))
        return self.p_part + self.integrator + self.d_part

    def _integrate(self, dt: float, limited: bool) -> None:
        gain = self._values[self._i]
        if gain == 0.0:
            self.integrator = 0.0
            return
        if not limited or self.integrator * self._error < 0.0:
            limit = max(self._values[self._imax], self.least_imax)
            self.integrator = clamp(self.integrator + self._error * gain * dt, -limit, limit)

    def _limit_p_and_d(self, limit: float) -> None:
        size = abs(self.p_part + self.d_part)
        if 0.0 < limit < size:
            self.p_part *= limit / size
            self.d_part *= limit / size
