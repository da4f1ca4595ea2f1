"""ArduRover's heading loop: angle P over a turn-rate FF/P/I/D, with limits, filters and speed scaling.

``servo = scale * (FF rT + P e + I int(e) + D de/dt)``, ``rT`` from ``ATC_STR_ANG_P * (psi_d - psi)``; ``scale`` is
``MOT_SPD_SCA_BASE/V`` above that speed and 1 below, where the integral cannot grow (:mod:`.rover_steering`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.design.laws import rover_steering as steering
from gcs_autotune.design.laws.kernel import (
    MAX_STANDING_ERROR,
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


def _fly(
    gains: NDArray[np.float64],
    limits: NDArray[np.float64],
    gyro: NDArray[np.float64],
    plant: NDArray[np.float64],
    actuator: NDArray[np.float64],
    position: NDArray[np.float64],
    output: NDArray[np.float64],
) -> None:
    kff, kp, ki, kd, ang = gains[0], gains[1], gains[2], gains[3], gains[4]
    imax, rate_max, acc_max, stop_acc, scale, grows, throttle = (
        limits[0],
        limits[1],
        limits[2],
        limits[3],
        limits[4],
        limits[5] > 0.0,
        limits[6],
    )
    dt, late, step, push, push_at = plant[4], plant[6], plant[7], plant[8], plant[9]
    step_at, rest, back_at = plant[10], plant[11], plant[12]
    f_t, f_e, f_d = smoothing(limits[7], dt), smoothing(limits[8], dt), smoothing(limits[9], dt)
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
        measured = gyro[0] * r + gyro[1] * x1 + gyro[2] * x2 - gyro[3] * y1 - gyro[4] * y2
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
    vector: Sequence[str] = (FF, P, I, D, ANG)
    filters: Sequence[str] = steering.FILTERS
    gyro = steering.GYRO

    def matching_speed(self, settings: Settings, speed: float | None) -> float | None:
        """Return *speed*, or just above MOT_SPD_SCA_BASE: same scale, but the integral acts."""
        return steering.matching_speed(settings, speed)

    def velocity_limit(self, settings: Settings, speed: float | None) -> float:
        """Return the least of ATC_STR_RAT_MAX and ATC_TURN_MAX_G at *speed* [rad/s]."""
        return steering.turn_limit(settings, speed)

    def limits(self, settings: Settings, speed: float | None, dt: float) -> Sequence[float]:
        """Return IMAX, turn rate, acceleration, deceleration, scale, whether the integral grows, and the
        throttle beside."""
        acc = math.radians(self._get(settings, "ATC_STR_ACC_MAX"))
        stop = math.radians(self._get(settings, "ATC_STR_DEC_MAX"))
        return (
            self._get(settings, "ATC_STR_RAT_IMAX"),
            steering.turn_limit(settings, speed),
            acc,
            stop if stop > 0.0 else acc,
            steering.scale(settings, speed),
            float(steering.integral_grows(settings, speed)),
            steering.beside(settings),
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
