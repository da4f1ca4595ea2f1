"""ArduRover's heading loop: angle P over a turn-rate FF/P/I/D, with limits, filters and speed scaling.

``servo = scale * (FF rT + P e + I int(e) + D de/dt)``, ``rT`` from ``ATC_STR_ANG_P * (psi_d - psi)``; ``scale`` is
``MOT_SPD_SCA_BASE/V`` above that speed and 1 below, where the integral cannot grow (:mod:`.rover_steering`).
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
    MAX_STANDING_ERROR,
    Cutoffs,
    GyroFilter,
    LoopPlant,
    actuate,
    advance,
    clip,
    compiled,
    delayed,
    mixed,
    smoothing,
    wrap,
)
from gcs_autotune.design.laws.law import Settings
from gcs_autotune.design.laws.loops import PositionLoop
from gcs_autotune.design.laws.rover_steering import FF, D, I, P
from gcs_autotune.design.open_loop import (
    Rational,
    constant,
    first_order,
    integral_over_proportional,
    integrator,
    second_order,
)
from gcs_autotune.design.result import ReferenceModel
from gcs_autotune.models import SingleDof

__all__ = ["RoverHeading"]

ANG = "ATC_STR_ANG_P"
LOW_FEED = 0.7
"""Feed-forward below this share of the model's own is worth a note."""
BARELY = 1.1
"""ATC_STR_ANG_P up to this is held back by the least that is documented, 1."""


class _Gains(NamedTuple):
    """In the order of ``vector``."""

    kff: float
    kp: float
    ki: float
    kd: float
    ang: float


class _Limits(NamedTuple):
    """See ``limits``; a switch acts above 0."""

    imax: float
    rate_max: float
    acc_max: float
    stop_acc: float
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
    position: NDArray[np.float64],
    output: NDArray[np.float64],
) -> None:
    kff, kp, ki, kd, ang = gains.kff, gains.kp, gains.ki, gains.kd, gains.ang
    imax, rate_max, acc_max, stop_acc, scale, grows, throttle = (
        limits.imax,
        limits.rate_max,
        limits.acc_max,
        limits.stop_acc,
        limits.scale,
        limits.grows > 0.0,
        limits.throttle,
    )
    dt, late, step, push, push_at = plant.dt, plant.late, plant.step, plant.push, plant.push_at
    step_at, rest, back_at = plant.step_at, plant.settled, plant.back_at
    f_t, f_e, f_d = smoothing(cutoffs.target, dt), smoothing(cutoffs.error, dt), smoothing(cutoffs.slope, dt)
    r = slope = x1 = x2 = y1 = y2 = 0.0
    integral = clip(-rest / scale, -imax, imax) if (grows and ki > 0.0) else 0.0
    demand = -(rest / scale + integral) / max(kff + kp, 1e-9)
    demand = target = error = clip(demand, -rate_max, rate_max)
    psi = clip(-demand / ang, -MAX_STANDING_ERROR, MAX_STANDING_ERROR)
    trim = scale * (integral + (kff + kp) * demand)
    limited = not grows
    memory = np.zeros(4)
    for k in range(len(position)):
        position[k] = psi
        aim = step if step_at <= k < back_at else 0.0
        measured = gyro.b0 * r + gyro.b1 * x1 + gyro.b2 * x2 - gyro.a1 * y1 - gyro.a2 * y2
        x2, x1, y2, y1 = x1, r, y1, measured
        e = wrap(aim - psi)
        wish = ang * e
        if stop_acc > 0.0:
            most = math.sqrt(2.0 * abs(e) * stop_acc)
            wish = clip(wish, -most, most)
        if acc_max > 0.0:
            wish = clip(wish, demand - acc_max * dt, demand + acc_max * dt)
        demand = clip(wish, -rate_max, rate_max)
        target += f_t * (demand - target)
        before = error
        error += f_e * (target - measured - error)
        slope += f_d * ((error - before) / dt - slope)
        if not limited or integral * error < 0.0:
            integral = clip(integral + ki * error * dt, -imax, imax)
        u = scale * (kff * target + kp * error + integral + kd * slope)
        servo = mixed(clip(u, -1.0, 1.0), throttle)
        limited = not grows or servo != u
        output[k] = servo
        applied = actuate(delayed(output, k, late, trim), actuator, memory)
        force = applied + (push if k >= push_at else 0.0)
        psi, r = advance(psi, r, force, plant)


class RoverHeading(PositionLoop):
    """``Axis.law == "rover-heading"``."""

    name = "rover-heading"
    tuned: Sequence[str] = (FF, P, I, ANG)
    integral = I
    fixed: Settings = steering.FIXED
    late: Sequence[str] = (D,)
    usual_step = math.radians(30.0)
    defaults: Settings = steering.DEFAULTS
    kernel = staticmethod(compiled(_fly))
    gains = _Gains
    vector: Sequence[str] = (FF, P, I, D, ANG)
    filters: Sequence[str] = steering.FILTERS
    gyro = steering.GYRO

    def matching_speed(self, settings: Settings, speed: float | None) -> float | None:
        """Return *speed*, or just above MOT_SPD_SCA_BASE: same scale, but the integral acts."""
        return steering.matching_speed(settings, speed)

    def velocity_limit(self, settings: Settings, speed: float | None) -> float:
        """Return the least of ATC_STR_RAT_MAX and ATC_TURN_MAX_G at *speed* [rad/s]."""
        return steering.turn_limit(settings, speed)

    def limits(self, settings: Settings, speed: float | None, dt: float) -> _Limits:
        """Return IMAX, turn rate, acceleration, deceleration, scale, whether the integral grows, and the
        throttle beside."""
        acc = math.radians(self._get(settings, "ATC_STR_ACC_MAX"))
        stop = math.radians(self._get(settings, "ATC_STR_DEC_MAX"))
        return _Limits(
            imax=self._get(settings, "ATC_STR_RAT_IMAX"),
            rate_max=steering.turn_limit(settings, speed),
            acc_max=acc,
            stop_acc=stop if stop > 0.0 else acc,
            scale=steering.scale(settings, speed),
            grows=float(steering.integral_grows(settings, speed)),
            throttle=steering.beside(settings),
        )

    def starts(
        self, model: SingleDof, wanted: ReferenceModel, settings: Settings, speed: float | None
    ) -> list[dict[str, float]]:
        """Match coefficients, with ``G = K/(T s + 1)``, ``FF = 1/K``.

        ``a3 = T/(K I A)``, ``a2 = (1 + K P)/(K I A)``, ``a1 = 1/A + (FF + P)/I``. The quadratic in A has no real
        root for every wish; then its real part is taken. The second start drops the integral:
        ``a1 = 1/A``, ``a2 = T/(A (1 + K P))``.
        """
        scale = steering.scale(settings, speed)
        drag = model.equivalent_drag(self.usual_step / wanted.a1) / scale
        alpha = model.alpha / scale
        p = max(wanted.a2 / wanted.a3 * alpha - drag, 0.0)
        q = (p + drag) * wanted.a3 / alpha
        root = max(wanted.a1**2 - 4.0 * q, 0.0)
        angle = (wanted.a1 - math.sqrt(root)) / (2.0 * q)
        exact = {FF: drag, P: p, I: alpha / (wanted.a3 * angle), ANG: angle}
        two = max(wanted.a1 / wanted.a2 * alpha - drag, 0.0)
        gentle = {FF: drag, P: two, I: 0.2 * (drag + two) / wanted.a1, ANG: 1.0 / wanted.a1}
        return [exact, gentle]

    def _angle(self, settings: Settings) -> Rational:
        """Return heading to wanted turn rate."""
        return first_order(self._get(settings, "ATC_STR_RAT_FLTT")) * constant(settings[ANG])

    def controller(self, settings: Settings, speed: float | None) -> Rational:
        """Return measured turn rate to servo."""
        feed, pid = constant(settings[FF] * steering.scale(settings, speed)), steering.steering_pid(settings, speed)
        turn = self._angle(settings) * integrator()
        return feed * turn + pid * (turn + second_order(self._get(settings, self.gyro)))

    def position_path(self, settings: Settings, speed: float | None) -> Rational:
        """Return measured heading to servo."""
        feed = constant(settings[FF] * steering.scale(settings, speed))
        return (feed + steering.steering_pid(settings, speed)) * self._angle(settings)

    def integral_rate(self, settings: Settings, speed: float | None) -> float:
        """Return ``A I / (A (FF + P) + I)``, infinite where the integral is frozen."""
        if not steering.integral_grows(settings, speed):
            return math.inf
        return integral_over_proportional(settings[ANG], settings[FF] + settings[P], settings[I])

    def notes(self, model: SingleDof, settings: Settings, speed: float | None) -> list[str]:
        """Say at which speeds the gains hold, and how turn rates are followed."""
        vectored = steering.vectored_angle(settings) > 0.0
        plain = steering.is_skid(settings) or (not vectored and steering.integral_grows(settings, speed))
        feed = self._feed_notes(model, settings, speed) if plain else []
        return [*steering.speed_notes(model, settings, speed), *feed]

    def _feed_notes(self, model: SingleDof, settings: Settings, speed: float | None) -> list[str]:
        ideal = steering.ideal_feed_forward(model, settings, speed)
        if settings[FF] >= LOW_FEED * ideal:
            return []
        most = math.degrees(abs(model.steady_velocity(1.0)))
        bound = settings[ANG] <= BARELY
        why = f"{ANG} cannot go below 1 and the heading loop needs less" if bound else "the step in heading needs less"
        return [
            f"turn rates would be followed best with {FF} = {ideal:.2g}, but {why}; the craft can turn at {most:.0f} "
            f"deg/s at most at this speed, while ATC_STR_RAT_MAX asks for up to "
            f"{self._get(settings, 'ATC_STR_RAT_MAX'):g} deg/s"
        ]
