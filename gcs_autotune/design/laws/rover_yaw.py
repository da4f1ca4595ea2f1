"""ArduRover's turn-rate loop alone: what a pilot feels in ACRO, what GUIDED turn rates and the heading loop rest on.

``servo = scale (FF rT + P e + I int(e) + D de/dt)``; limits, filters and scaling as in :mod:`.rover_heading`. The step
goes from half of it to port to half of it to starboard. What is told as position is the turn rate.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.design.actuator import PERFECT, Actuator
from gcs_autotune.design.laws.about_speed import AboutSpeed, start_of
from gcs_autotune.design.laws.kernel import (
    actuate,
    advance,
    clip,
    compiled,
    gyro_coefficients,
    plant_vector,
    smoothing,
)
from gcs_autotune.design.laws.law import Motion, Scenario, Settings, setting
from gcs_autotune.design.laws.rover_heading import DEFAULTS as OF_HEADING
from gcs_autotune.design.laws.rover_heading import RoverHeading
from gcs_autotune.design.open_loop import Rational, constant, first_order, integrator, second_order
from gcs_autotune.design.result import ModelFunction
from gcs_autotune.models import SingleDof

__all__ = ["RoverYaw"]

FF, P, I, D = "ATC_STR_RAT_FF", "ATC_STR_RAT_P", "ATC_STR_RAT_I", "ATC_STR_RAT_D"  # noqa: E741 - the integral gain
BEFORE = 8.0
"""A loop that has long settled is shown from so much [s] of holding its rate."""
FIXED: Settings = {D: 0.0}
DEFAULTS: Settings = {n: v for n, v in OF_HEADING.items() if n != "ATC_STR_DEC_MAX"}
Array = NDArray[np.float64]


def _fly(
    gains: Array,
    limits: Array,
    gyro: Array,
    plant: Array,
    actuator: Array,
    start: Array,
    position: Array,
    output: Array,
) -> None:
    kff, kp, ki, kd = gains[0], gains[1], gains[2], gains[3]
    imax, rate_max, acc_max, scale, grows = limits[0], limits[1], limits[2], limits[3], limits[4] > 0.0
    dt, wait, step, push, push_at, step_at = plant[4], int(plant[6]), plant[7], plant[8], plant[9], plant[10]
    f_t, f_e, f_d = smoothing(limits[5], dt), smoothing(limits[6], dt), smoothing(limits[7], dt)
    v0, trim, before = start[0], start[1], int(start[2])
    r = x1 = x2 = y1 = y2 = demand = target = v0
    psi = slope = error = 0.0
    integral = clip(trim / scale - kff * v0, -imax, imax) if (before > 0 and grows and ki > 0.0) else 0.0
    limited = not grows
    memory = np.zeros(4)
    sent = np.empty(before + len(position))
    for j in range(len(sent)):
        k = j - before
        if k >= 0:
            position[k] = r - v0
        measured = gyro[0] * r + gyro[1] * x1 + gyro[2] * x2 - gyro[3] * y1 - gyro[4] * y2
        x2, x1, y2, y1 = x1, r, y1, measured
        wish = v0 + step if k >= step_at else v0
        if acc_max > 0.0:
            wish = clip(wish, demand - acc_max * dt, demand + acc_max * dt)
        demand = clip(wish, -rate_max, rate_max)
        target += f_t * (demand - target)
        last = error
        error += f_e * (target - measured - error)
        slope += f_d * ((error - last) / dt - slope)
        if not limited or integral * error < 0.0:
            integral = clip(integral + ki * error * dt, -imax, imax) if ki > 0.0 else 0.0
        u = scale * (kff * target + kp * error + integral + kd * slope)
        servo = clip(u, -1.0, 1.0)
        limited = not grows or servo != u
        sent[j] = servo
        if k >= 0:
            output[k] = servo
        applied = actuate(sent[j - wait] if j >= wait else trim, actuator, memory)
        psi, r = advance(psi, r, applied + (push if k >= push_at else 0.0), plant)


_kernel: Callable[..., Any] = compiled(_fly)


class RoverYaw(AboutSpeed):
    """``Axis.law == "rover-yaw"``."""

    name = "rover-yaw"
    tuned: Sequence[str] = (FF, P, I)
    integral = I
    fixed: Settings = FIXED
    usual_step = math.radians(30.0)
    defaults: Settings = DEFAULTS
    _heading = RoverHeading()

    def _get(self, settings: Settings, name: str) -> float:
        return setting(settings, self.defaults, name)

    def base(self, step: float, speed: float | None) -> float:
        """Return half the step to the other side."""
        return -0.5 * abs(step)

    def loop_period(self, settings: Settings) -> float:
        """Return the loop period [s]."""
        return self._heading.loop_period(settings)

    def matching_speed(self, settings: Settings, speed: float | None) -> float | None:
        """Return as the heading law does: where the integral acts."""
        return self._heading.matching_speed(settings, speed)

    def velocity_limit(self, settings: Settings, speed: float | None) -> float:
        """Return ATC_STR_ACC_MAX [rad/s^2]."""
        most = math.radians(self._get(settings, "ATC_STR_ACC_MAX"))
        return most if most > 0.0 else math.inf

    def starts(
        self, model: SingleDof, wanted: ModelFunction, settings: Settings, speed: float | None
    ) -> list[dict[str, float]]:
        """Feed the drag forward; PI for damping ``2/a1``, stiffness ``1/a1^2``; and half as quick."""
        scale = self._heading.scale(settings, speed)
        drag = model.equivalent_drag(0.5 * self.usual_step) / scale
        alpha = model.alpha / scale
        return [
            {FF: drag, P: max(2.0 * alpha * q / wanted.a1 - drag, 0.0), I: alpha * (q / wanted.a1) ** 2}
            for q in (2.0, 1.0)
        ]

    def simulate(
        self,
        model: SingleDof,
        settings: Settings,
        scenario: Scenario,
        speed: float | None,
        delay: float,
        actuator: Actuator = PERFECT,
    ) -> Motion:
        """Fly *scenario*."""
        dt = self.loop_period(settings)
        count = round(scenario.duration / dt) + 1
        position, output = np.empty(count), np.empty(count)
        v0 = start_of(scenario.step, self.base(scenario.step, speed))
        force = (model.beta + model.beta_quadratic * abs(v0)) * v0 - model.delta
        limits = np.array(
            [
                self._get(settings, "ATC_STR_RAT_IMAX"),
                self._heading.velocity_limit(settings, speed),
                math.radians(self._get(settings, "ATC_STR_ACC_MAX")),
                self._heading.scale(settings, speed),
                float(self._heading.integral_grows(settings, speed)),
                *(self._get(settings, f"ATC_STR_RAT_FLT{x}") for x in "TED"),
            ]
        )
        _kernel(
            np.array([settings.get(n, 0.0) for n in (FF, P, I, D)]),
            limits,
            gyro_coefficients(self._get(settings, "INS_GYRO_FILTER"), 1.0 / dt),
            plant_vector(model, scenario, dt, delay),
            actuator.vector(dt),
            np.array([v0, min(max(force, -1.0), 1.0), round(BEFORE / dt) if scenario.lead == 0.0 else 0]),
            position,
            output,
        )
        return Motion(dt * np.arange(count, dtype=np.float64), position, output)

    def controller(self, settings: Settings, speed: float | None) -> Rational:
        """Return measured turn rate to servo; the feed-forward is outside the loop."""
        scale = self._heading.scale(settings, speed)
        pid = constant(settings[P] * scale)
        if settings[I] > 0.0 and self._heading.integral_grows(settings, speed):
            pid = pid + integrator(settings[I] * scale)
        if settings[D] > 0.0:
            slope = Rational(np.array([settings[D] * scale, 0.0]), np.array([1.0]))
            pid = pid + slope * first_order(self._get(settings, "ATC_STR_RAT_FLTD"))
        gyro = second_order(self._get(settings, "INS_GYRO_FILTER"))
        return pid * first_order(self._get(settings, "ATC_STR_RAT_FLTE")) * gyro

    def position_path(self, settings: Settings, speed: float | None) -> Rational:
        """Return measured turn rate to servo: here the same as :meth:`controller`."""
        return self.controller(settings, speed)

    def integral_rate(self, settings: Settings, speed: float | None) -> float:
        """Return ``I / (P + FF)``, the feed-forward standing for the craft's own drag; infinite where it is frozen."""
        if not self._heading.integral_grows(settings, speed):
            return math.inf
        return settings[I] / max(settings[P] + settings[FF], 1e-12)

    def notes(self, model: SingleDof, settings: Settings, speed: float | None) -> list[str]:
        """Say at which speeds the gains hold, and what rests on them."""
        return [
            *self._heading.speed_notes(model, settings, speed),
            "ATC_STR_ANG_P was left alone: `tune heading` chooses it together with these gains",
        ]
