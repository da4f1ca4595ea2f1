"""ArduSub's heading loop: shaped target, square-root angle controller, yaw-rate P/I/D.

``N = P e + I int(e) + D de/dt`` with ``e = LPF(r_t) - r``. Sub reads ATC_RAT_YAW_FF and never uses it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.design.actuator import ActuatorStep
from gcs_autotune.design.laws.kernel import (
    MAX_STANDING_ERROR,
    Cutoffs,
    GyroFilter,
    LoopPlant,
    actuate,
    advance,
    clip,
    compiled,
    delayed,
    smoothing,
    sqrt_control,
    wrap,
)
from gcs_autotune.design.laws.law import Settings
from gcs_autotune.design.laws.loops import PositionLoop
from gcs_autotune.design.open_loop import (
    Rational,
    constant,
    first_order,
    integral_over_proportional,
    integrator,
    pid_path,
    second_order,
)
from gcs_autotune.design.result import ReferenceModel
from gcs_autotune.models import SingleDof

__all__ = ["SubHeading"]

P, I, D, ANG = "ATC_RAT_YAW_P", "ATC_RAT_YAW_I", "ATC_RAT_YAW_D", "ATC_ANG_YAW_P"  # noqa: E741
ACCELERATION = (math.radians(10.0), math.radians(120.0))
"""Bounds of the angle controller's deceleration [rad/s^2] (half of ATC_ACCEL_Y_MAX, kept within these)."""
ERROR_MAX = math.radians(45.0)
"""The target is pulled along so that it never leads by more."""


class _Gains(NamedTuple):
    """In the order of ``vector``."""

    kp: float
    ki: float
    kd: float
    ang: float


class _Limits(NamedTuple):
    """See ``limits``; a switch acts above 0."""

    imax: float
    rate_max: float
    shape_acc: float
    slew: float
    tc: float
    shaped: float
    stop_acc: float


def _fly(
    gains: _Gains,
    limits: _Limits,
    cutoffs: Cutoffs,
    gyro: GyroFilter,
    plant: LoopPlant,
    actuator: ActuatorStep,
    position: NDArray[np.float64],
    output: NDArray[np.float64],
) -> None:
    kp, ki, kd, ang = gains.kp, gains.ki, gains.kd, gains.ang
    imax, rate_max, shape_acc, slew, tc, shaped, stop_acc = (
        limits.imax,
        limits.rate_max,
        limits.shape_acc,
        limits.slew,
        limits.tc,
        limits.shaped > 0.0,
        limits.stop_acc,
    )
    dt, late, step, push, push_at = plant.dt, plant.late, plant.step, plant.push, plant.push_at
    step_at, rest, back_at = plant.step_at, plant.settled, plant.back_at
    f_t, f_e, f_d = smoothing(cutoffs.target, dt), smoothing(cutoffs.error, dt), smoothing(cutoffs.slope, dt)
    r = lead = lead_rate = slope = x1 = x2 = y1 = y2 = 0.0
    integral = clip(-rest, -imax, imax) if ki > 0.0 else 0.0
    target = error = clip(-(rest + integral) / max(kp, 1e-9), -rate_max, rate_max)
    psi = clip(-target / max(ang, 1e-9), -MAX_STANDING_ERROR, MAX_STANDING_ERROR)
    trim = integral + kp * target
    limited = False
    memory = np.zeros(4)
    for k in range(len(position)):
        position[k] = psi
        aim = step if step_at <= k < back_at else 0.0
        measured = gyro.b0 * r + gyro.b1 * x1 + gyro.b2 * x2 - gyro.a1 * y1 - gyro.a2 * y2
        x2, x1, y2, y1 = x1, r, y1, measured
        ahead = wrap(aim - lead)
        if shaped:
            wish = clip(sqrt_control(ahead, 1.0 / tc, shape_acc), -slew, slew)
            lead_rate = clip(wish, lead_rate - shape_acc * dt, lead_rate + shape_acc * dt)
            lead += lead_rate * dt
        else:
            lead += clip(ahead, -slew * dt, slew * dt)
        e = wrap(lead - psi)
        if abs(e) > ERROR_MAX:
            e = clip(e, -ERROR_MAX, ERROR_MAX)
            lead = psi + e
        demand = clip(sqrt_control(e, ang, stop_acc) + lead_rate, -rate_max, rate_max)
        target += f_t * (demand - target)
        before = error
        error += f_e * (target - measured - error)
        slope += f_d * ((error - before) / dt - slope)
        if not limited or integral * error < 0.0:
            integral = clip(integral + ki * error * dt, -imax, imax)
        u = kp * error + integral + kd * slope
        thrust = clip(u, -1.0, 1.0)
        limited = thrust != u
        output[k] = thrust
        applied = actuate(delayed(output, k, late, trim), actuator, memory)
        psi, r = advance(psi, r, applied + (push if k >= push_at else 0.0), plant)


FILTERS = ("ATC_RAT_YAW_FLTT", "ATC_RAT_YAW_FLTE", "ATC_RAT_YAW_FLTD")
FIXED: Settings = {D: 0.0}
DEFAULTS: Settings = {
    "ATC_RAT_YAW_IMAX": 0.222,
    "ATC_RAT_YAW_FLTT": 5.0,
    "ATC_RAT_YAW_FLTE": 0.0,
    "ATC_RAT_YAW_FLTD": 5.0,
    "ATC_ACCEL_Y_MAX": 110000.0,
    "ATC_RATE_Y_MAX": 180.0,
    "ATC_SLEW_YAW": 6000.0,
    "ATC_INPUT_TC": 0.15,
    "ATC_RATE_FF_ENAB": 1.0,
    "INS_GYRO_FILTER": 20.0,
    "SCHED_LOOP_RATE": 400.0,
}


class SubHeading(PositionLoop):
    """``Axis.law == "sub-heading"``."""

    name = "sub-heading"
    tuned: Sequence[str] = (P, I, ANG)
    integral = I
    fixed: Settings = FIXED
    usual_step = math.radians(30.0)
    defaults: Settings = DEFAULTS
    kernel = staticmethod(compiled(_fly))
    gains = _Gains
    vector: Sequence[str] = (P, I, D, ANG)
    filters: Sequence[str] = FILTERS
    gyro = "INS_GYRO_FILTER"

    def _rate_max(self, settings: Settings) -> float:
        rate = math.radians(self._get(settings, "ATC_RATE_Y_MAX"))
        return rate if rate > 0.0 else 1e6

    def velocity_limit(self, settings: Settings, speed: float | None) -> float:
        """Return the lesser of ATC_RATE_Y_MAX and ATC_SLEW_YAW [rad/s]."""
        return min(self._rate_max(settings), math.radians(self._get(settings, "ATC_SLEW_YAW") / 100.0))

    def starts(
        self, model: SingleDof, wanted: ReferenceModel, settings: Settings, speed: float | None
    ) -> list[dict[str, float]]:
        """Match coefficients: ``a3 = alpha/(I A)``, ``a2 = (beta + P)/(I A)``, ``a1 = 1/A + P/I``.

        Where the quadratic in A has no real root its real part is taken. The second start drops the integral:
        ``a2 = alpha/(A P)``, ``a1 = (beta + P)/(A P)``.
        """
        drag = model.equivalent_drag(self.usual_step / wanted.a1)
        p = max(wanted.a2 / wanted.a3 * model.alpha - drag, 1e-3)
        q = p * wanted.a3 / model.alpha
        root = max(wanted.a1**2 - 4.0 * q, 0.0)
        angle = (wanted.a1 - math.sqrt(root)) / (2.0 * q)
        two = max(wanted.a1 / wanted.a2 * model.alpha - drag, 0.1 * wanted.a1 / wanted.a2 * model.alpha)
        return [
            {P: p, I: model.alpha / (wanted.a3 * angle), ANG: angle},
            {P: two, I: 0.2 * two / wanted.a1, ANG: model.alpha / (wanted.a2 * two)},
        ]

    def limits(self, settings: Settings, speed: float | None, dt: float) -> _Limits:
        """Return IMAX, turn rate, shaping acceleration, slew, its time constant, whether it acts, deceleration."""
        shape = math.radians(self._get(settings, "ATC_ACCEL_Y_MAX") / 100.0)
        return _Limits(
            imax=self._get(settings, "ATC_RAT_YAW_IMAX"),
            rate_max=self._rate_max(settings),
            shape_acc=shape if shape > 0.0 else 1e6,
            slew=math.radians(self._get(settings, "ATC_SLEW_YAW") / 100.0),
            tc=max(self._get(settings, "ATC_INPUT_TC"), 0.01),
            shaped=self._get(settings, "ATC_RATE_FF_ENAB"),
            stop_acc=min(max(0.5 * shape, ACCELERATION[0]), ACCELERATION[1]),
        )

    def _parts(self, settings: Settings) -> tuple[Rational, Rational]:
        """PID (turn rate to output), and the angle loop (heading to turn rate)."""
        pid = pid_path(
            settings[P],
            settings[I],
            settings[D],
            error_cutoff=self._get(settings, "ATC_RAT_YAW_FLTE"),
            slope_cutoff=self._get(settings, "ATC_RAT_YAW_FLTD"),
        )
        return pid, first_order(self._get(settings, "ATC_RAT_YAW_FLTT")) * constant(settings[ANG])

    def controller(self, settings: Settings, speed: float | None) -> Rational:
        """Return measured turn rate to output, the angle controller in its linear range."""
        pid, angle = self._parts(settings)
        return pid * (angle * integrator() + second_order(self._get(settings, self.gyro)))

    def position_path(self, settings: Settings, speed: float | None) -> Rational:
        """Return measured heading to output."""
        pid, angle = self._parts(settings)
        return pid * angle

    def integral_rate(self, settings: Settings, speed: float | None) -> float:
        """Return ``A I / (A P + I)``."""
        return integral_over_proportional(settings[ANG], settings[P], settings[I])

    def notes(self, model: SingleDof, settings: Settings, speed: float | None) -> list[str]:
        """Say what the gains do not cover."""
        return ["the yaw model was identified without way on; ArduSub does not scale its yaw gains with speed"]
