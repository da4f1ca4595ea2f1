"""ArduRover's turn-rate loop alone: what a pilot feels in ACRO, what GUIDED turn rates and the heading loop rest on.

``servo = scale (FF rT + P e + I int(e) + D de/dt)``; limits, filters and scaling as in :mod:`.rover_steering`. The step
goes from half of it to port to half of it to starboard. What is told as position is the turn rate.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.design.actuator import ActuatorStep
from gcs_autotune.design.laws import rover_steering as steering
from gcs_autotune.design.laws.kernel import (
    Cutoffs,
    GyroFilter,
    HeldVelocity,
    LoopPlant,
    actuate,
    advance,
    clip,
    compiled,
    delayed,
    mixed,
    smoothing,
)
from gcs_autotune.design.laws.law import Settings
from gcs_autotune.design.laws.loops import VelocityLoop
from gcs_autotune.design.laws.rover_steering import FF, D, I, P
from gcs_autotune.design.open_loop import Rational, second_order
from gcs_autotune.design.result import ReferenceModel
from gcs_autotune.models import SingleDof

__all__ = ["RoverYaw"]

DEFAULTS: Settings = {n: v for n, v in steering.DEFAULTS.items() if n != "ATC_STR_DEC_MAX"}
Array = NDArray[np.float64]


class _Gains(NamedTuple):
    """In the order of ``vector``."""

    kff: float
    kp: float
    ki: float
    kd: float


class _Limits(NamedTuple):
    """See ``limits``; a switch acts above 0."""

    imax: float
    rate_max: float
    acc_max: float
    scale: float
    grows: float
    throttle: float


def _fly(
    gains: _Gains,
    limits: _Limits,
    cutoffs: Cutoffs,
    gyro: GyroFilter,
    plant: LoopPlant,
    actuator: ActuatorStep,
    start: HeldVelocity,
    position: Array,
    output: Array,
) -> None:
    kff, kp, ki, kd = gains.kff, gains.kp, gains.ki, gains.kd
    imax, rate_max, acc_max, scale, grows = (
        limits.imax,
        limits.rate_max,
        limits.acc_max,
        limits.scale,
        limits.grows > 0.0,
    )
    throttle = limits.throttle
    dt, late, step, push, push_at, step_at = plant.dt, plant.late, plant.step, plant.push, plant.push_at, plant.step_at
    back_at = plant.back_at
    f_t, f_e, f_d = smoothing(cutoffs.target, dt), smoothing(cutoffs.error, dt), smoothing(cutoffs.slope, dt)
    v0, trim, before = start.velocity, start.output, int(start.before)
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
        measured = gyro.b0 * r + gyro.b1 * x1 + gyro.b2 * x2 - gyro.a1 * y1 - gyro.a2 * y2
        x2, x1, y2, y1 = x1, r, y1, measured
        wish = v0 + step if step_at <= k < back_at else v0
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
        servo = mixed(clip(u, -1.0, 1.0), throttle)
        limited = not grows or servo != u
        sent[j] = servo
        if k >= 0:
            output[k] = servo
        applied = actuate(delayed(sent, j, late, trim), actuator, memory)
        psi, r = advance(psi, r, applied + (push if k >= push_at else 0.0), plant)


class RoverYaw(VelocityLoop):
    """``Axis.law == "rover-yaw"``."""

    name = "rover-yaw"
    tuned: Sequence[str] = (FF, P, I)
    integral = I
    fixed: Settings = steering.FIXED
    usual_step = math.radians(30.0)
    both_ways = True
    hold = 8.0
    defaults: Settings = DEFAULTS
    kernel = staticmethod(compiled(_fly))
    gains = _Gains
    vector: Sequence[str] = (FF, P, I, D)
    filters: Sequence[str] = steering.FILTERS
    gyro = steering.GYRO

    def matching_speed(self, settings: Settings, speed: float | None) -> float | None:
        """Return as the heading law does: where the integral acts."""
        return steering.matching_speed(settings, speed)

    def velocity_limit(self, settings: Settings, speed: float | None) -> float:
        """Return ATC_STR_ACC_MAX [rad/s^2]."""
        most = math.radians(self._get(settings, "ATC_STR_ACC_MAX"))
        return most if most > 0.0 else math.inf

    def limits(self, settings: Settings, speed: float | None, dt: float) -> _Limits:
        """Return IMAX, turn rate, acceleration, scale, whether the integral grows, and the throttle beside."""
        return _Limits(
            imax=self._get(settings, "ATC_STR_RAT_IMAX"),
            rate_max=steering.turn_limit(settings, speed),
            acc_max=math.radians(self._get(settings, "ATC_STR_ACC_MAX")),
            scale=steering.scale(settings, speed),
            grows=float(steering.integral_grows(settings, speed)),
            throttle=steering.beside(settings),
        )

    def starts(
        self, model: SingleDof, wanted: ReferenceModel, settings: Settings, speed: float | None
    ) -> list[dict[str, float]]:
        """Feed the drag forward; PI for damping ``2/a1``, stiffness ``1/a1^2``; and half as quick."""
        scale = steering.scale(settings, speed)
        drag = model.equivalent_drag(0.5 * self.usual_step) / scale
        alpha = model.alpha / scale
        return [
            {FF: drag, P: max(2.0 * alpha * q / wanted.a1 - drag, 0.0), I: alpha * (q / wanted.a1) ** 2}
            for q in (2.0, 1.0)
        ]

    def controller(self, settings: Settings, speed: float | None) -> Rational:
        """Return measured turn rate to servo; the feed-forward is outside the loop."""
        return steering.steering_pid(settings, speed) * second_order(self._get(settings, self.gyro))

    def integral_rate(self, settings: Settings, speed: float | None) -> float:
        """Return ``I / (P + FF)``, the feed-forward standing for the craft's own drag; infinite where it is frozen."""
        if not steering.integral_grows(settings, speed):
            return math.inf
        return settings[I] / max(settings[P] + settings[FF], 1e-12)

    def notes(self, model: SingleDof, settings: Settings, speed: float | None) -> list[str]:
        """Say at which speeds the gains hold, and what rests on them."""
        return [
            *steering.speed_notes(model, settings, speed),
            "ATC_STR_ANG_P was left alone: `tune heading` chooses it together with these gains",
        ]
