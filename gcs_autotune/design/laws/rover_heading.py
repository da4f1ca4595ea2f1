"""ArduRover's heading loop: angle P over a turn-rate FF/P/I/D, with limits, filters and speed scaling.

``servo = scale * (FF rT + P e + I int(e) + D de/dt)``, ``rT`` from ``ATC_STR_ANG_P * (psi_d - psi)``; ``scale`` is
``MOT_SPD_SCA_BASE/V`` above that speed and 1 below, where the integral cannot grow.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.design.actuator import PERFECT, Actuator
from gcs_autotune.design.laws.about_rest import AboutRest
from gcs_autotune.design.laws.kernel import (
    STANDING_MOST,
    actuate,
    advance,
    clip,
    compiled,
    gyro_coefficients,
    plant_vector,
    smoothing,
    wrap,
)
from gcs_autotune.design.laws.law import SKID, Motion, Scenario, Settings, setting
from gcs_autotune.design.open_loop import Rational, constant, first_order, integrator, second_order
from gcs_autotune.design.result import ModelFunction
from gcs_autotune.models import SingleDof

__all__ = ["RoverHeading", "most_feed_forward"]

FF, P, I, D, ANG = (  # noqa: E741 - I is the integral gain
    "ATC_STR_RAT_FF",
    "ATC_STR_RAT_P",
    "ATC_STR_RAT_I",
    "ATC_STR_RAT_D",
    "ATC_STR_ANG_P",
)
GRAVITY = 9.80665
JUST_ABOVE = 1.0 + 1e-9
LEAST_THROTTLE = 0.05
"""Chosen: with vectored thrust, gains for less throttle than this would be gains for no steering at all."""
LOW_FEED = 0.7
"""Feed-forward below this share of the model's own is worth a note."""
BARELY = 1.1
"""ATC_STR_ANG_P up to this is held back by the least that is documented, 1."""
MOST_FEED = 1.3
"""Chosen: feed-forward above this share of the model's own is not offered. On a craft that answers at once a larger one
with a smaller ATC_STR_ANG_P steps as well in heading, but turns so much faster than it is told in every other mode."""


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
    imax, rate_max, acc_max, stop_acc, scale, grows = (
        limits[0],
        limits[1],
        limits[2],
        limits[3],
        limits[4],
        limits[5] > 0.0,
    )
    dt, wait, step, push, push_at = plant[4], int(plant[6]), plant[7], plant[8], plant[9]
    step_at, rest = plant[10], plant[11]
    f_t, f_e, f_d = smoothing(limits[6], dt), smoothing(limits[7], dt), smoothing(limits[8], dt)
    r = slope = x1 = x2 = y1 = y2 = 0.0
    integral = clip(-rest / scale, -imax, imax) if (grows and ki > 0.0) else 0.0
    demand = -(rest / scale + integral) / max(kff + kp, 1e-9)
    demand = target = error = clip(demand, -rate_max, rate_max)
    psi = clip(-demand / ang, -STANDING_MOST, STANDING_MOST)
    trim = scale * (integral + (kff + kp) * demand)
    limited = not grows
    memory = np.zeros(4)
    for k in range(len(position)):
        position[k] = psi
        aim = step if k >= step_at else 0.0
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
        servo = clip(u, -1.0, 1.0)
        limited = not grows or servo != u
        output[k] = servo
        applied = actuate(output[k - wait] if k >= wait else trim, actuator, memory)
        force = applied + (push if k >= push_at else 0.0)
        psi, r = advance(psi, r, force, plant)


_kernel: Callable[..., Any] = compiled(_fly)

FIXED: Settings = {D: 0.0}
DEFAULTS: Settings = {
    "ATC_STR_RAT_IMAX": 1.0,
    "ATC_STR_RAT_FLTT": 0.0,
    "ATC_STR_RAT_FLTE": 10.0,
    "ATC_STR_RAT_FLTD": 0.0,
    "ATC_STR_RAT_MAX": 120.0,
    "ATC_STR_ACC_MAX": 120.0,
    "ATC_STR_DEC_MAX": 0.0,
    "ATC_TURN_MAX_G": 0.6,
    "MOT_SPD_SCA_BASE": 1.0,
    "MOT_VEC_ANGLEMAX": 0.0,
    "CRUISE_SPEED": 2.0,
    "CRUISE_THROTTLE": 50.0,
    "INS_GYRO_FILTER": 4.0,
    "SCHED_LOOP_RATE": 50.0,
}


class RoverHeading(AboutRest):
    """``Axis.law == "rover-heading"``."""

    name = "rover-heading"
    tuned: Sequence[str] = (FF, P, I, ANG)
    integral = I
    fixed: Settings = FIXED
    late: Sequence[str] = (D,)
    usual_step = math.radians(30.0)
    defaults: Settings = DEFAULTS

    def _get(self, settings: Settings, name: str) -> float:
        return setting(settings, self.defaults, name)

    def loop_period(self, settings: Settings) -> float:
        """Return the loop period [s]."""
        return 1.0 / self._get(settings, "SCHED_LOOP_RATE")

    def is_skid(self, settings: Settings) -> bool:
        """Whether the boat steers by the difference of two thrusters: never scaled with speed, never frozen."""
        return settings.get(SKID, 0.0) > 0.0

    def scale(self, settings: Settings, speed: float | None) -> float:
        """Return servo per controller output at *speed* [m/s].

        With vectored thrust the servo gets ``atan(output / throttle)`` of MOT_VEC_ANGLEMAX: here its slope, at the
        throttle that CRUISE_THROTTLE and CRUISE_SPEED say the autopilot drives at that speed with.
        """
        if self.is_skid(settings):
            return 1.0
        widest = self._widest(settings)
        if widest > 0.0:
            return 1.0 / (self._throttle(settings, speed) * widest)
        base = self._get(settings, "MOT_SPD_SCA_BASE")
        return base / speed if speed is not None and speed > base > 0.0 else 1.0

    def _widest(self, settings: Settings) -> float:
        """Return the angle [rad] to which full steering turns the thrust; 0 with a rudder."""
        return math.radians(min(max(self._get(settings, "MOT_VEC_ANGLEMAX"), 0.0), 90.0))

    def _throttle(self, settings: Settings, speed: float | None) -> float:
        cruise = self._get(settings, "CRUISE_SPEED")
        share = 1.0 if speed is None or cruise <= 0.0 else speed / cruise
        return min(max(self._get(settings, "CRUISE_THROTTLE") / 100.0 * share, LEAST_THROTTLE), 1.0)

    def integral_grows(self, settings: Settings, speed: float | None) -> bool:
        """Whether the integral term can grow at *speed*: not at or below MOT_SPD_SCA_BASE."""
        if self.is_skid(settings) or self._get(settings, "MOT_VEC_ANGLEMAX") > 0.0:
            return True
        return speed is None or speed > self._get(settings, "MOT_SPD_SCA_BASE") > 0.0

    def matching_speed(self, settings: Settings, speed: float | None) -> float | None:
        """Return *speed*, or just above MOT_SPD_SCA_BASE: same scale, but the integral acts."""
        if speed is None or self.is_skid(settings):
            return speed
        return max(speed, JUST_ABOVE * self._get(settings, "MOT_SPD_SCA_BASE"))

    def velocity_limit(self, settings: Settings, speed: float | None) -> float:
        """Return the least of ATC_STR_RAT_MAX and ATC_TURN_MAX_G at *speed* [rad/s]."""
        rate = math.radians(self._get(settings, "ATC_STR_RAT_MAX"))
        lateral = self._get(settings, "ATC_TURN_MAX_G") * GRAVITY / max(speed or 0.0, 1.0)
        return min(rate if rate > 0.0 else math.inf, lateral if lateral > 0.0 else math.inf)

    def starts(
        self, model: SingleDof, wanted: ModelFunction, settings: Settings, speed: float | None
    ) -> list[dict[str, float]]:
        """Match coefficients, with ``G = K/(T s + 1)``, ``FF = 1/K``.

        ``a3 = T/(K I A)``, ``a2 = (1 + K P)/(K I A)``, ``a1 = 1/A + (FF + P)/I``. The quadratic in A has no real
        root for every wish; then its real part is taken. The second start drops the integral:
        ``a1 = 1/A``, ``a2 = T/(A (1 + K P))``.
        """
        scale = self.scale(settings, speed)
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
        acc = math.radians(self._get(settings, "ATC_STR_ACC_MAX"))
        stop = math.radians(self._get(settings, "ATC_STR_DEC_MAX"))
        limits = np.array(
            [
                self._get(settings, "ATC_STR_RAT_IMAX"),
                self.velocity_limit(settings, speed),
                acc,
                stop if stop > 0.0 else acc,
                self.scale(settings, speed),
                float(self.integral_grows(settings, speed)),
                *(self._get(settings, f"ATC_STR_RAT_FLT{x}") for x in "TED"),
            ]
        )
        gains = np.array([settings[n] for n in (FF, P, I, D, ANG)])
        gyro = gyro_coefficients(self._get(settings, "INS_GYRO_FILTER"), 1.0 / dt)
        _kernel(
            gains,
            limits,
            gyro,
            plant_vector(model, scenario, dt, delay, actuator),
            actuator.vector(dt),
            position,
            output,
        )
        return Motion(dt * np.arange(count, dtype=np.float64), position, output)

    def _parts(self, settings: Settings, speed: float | None) -> tuple[Rational, Rational, Rational]:
        """Feed-forward and PID (per wanted turn rate, to servo), and the angle loop (heading to turn rate)."""
        scale = self.scale(settings, speed)
        pid = constant(settings[P] * scale)
        if settings[I] > 0.0 and self.integral_grows(settings, speed):
            pid = pid + integrator(settings[I] * scale)
        if settings[D] > 0.0:
            slope = Rational(np.array([settings[D] * scale, 0.0]), np.array([1.0]))
            pid = pid + slope * first_order(self._get(settings, "ATC_STR_RAT_FLTD"))
        pid = pid * first_order(self._get(settings, "ATC_STR_RAT_FLTE"))
        angle = first_order(self._get(settings, "ATC_STR_RAT_FLTT")) * constant(settings[ANG])
        return constant(settings[FF] * scale), pid, angle

    def controller(self, settings: Settings, speed: float | None) -> Rational:
        """Return measured turn rate to servo."""
        feed, pid, angle = self._parts(settings, speed)
        gyro = second_order(self._get(settings, "INS_GYRO_FILTER"))
        turn = angle * integrator()
        return feed * turn + pid * (turn + gyro)

    def position_path(self, settings: Settings, speed: float | None) -> Rational:
        """Return measured heading to servo."""
        feed, pid, angle = self._parts(settings, speed)
        return (feed + pid) * angle

    def integral_rate(self, settings: Settings, speed: float | None) -> float:
        """Return ``A I / (A (FF + P) + I)``, infinite where the integral is frozen."""
        if not self.integral_grows(settings, speed):
            return math.inf
        proportional = settings[ANG] * (settings[FF] + settings[P]) + settings[I]
        return settings[ANG] * settings[I] / max(proportional, 1e-12)

    def notes(self, model: SingleDof, settings: Settings, speed: float | None) -> list[str]:
        """Say at which speeds the gains hold, and how turn rates are followed."""
        vectored = self._get(settings, "MOT_VEC_ANGLEMAX") > 0.0
        plain = self.is_skid(settings) or (not vectored and self.integral_grows(settings, speed))
        feed = self._feed_notes(model, settings, speed) if plain else []
        return [*self.speed_notes(model, settings, speed), *feed]

    def speed_notes(self, model: SingleDof, settings: Settings, speed: float | None) -> list[str]:
        """Say at which speeds the gains hold."""
        base = self._get(settings, "MOT_SPD_SCA_BASE")
        if self.is_skid(settings):
            return [
                f"steered by two thrusters: the autopilot never scales their difference with speed, so the gains are "
                f"those of {speed or 0.0:.2f} m/s and this throttle; thrust that goes with the square of the pulse "
                "steers harder at more throttle, weaker at less, unless MOT_THST_EXPO straightens it"
            ]
        if self._widest(settings) > 0.0:
            return [
                "vectored thrust (MOT_VEC_ANGLEMAX > 0): the autopilot turns the thrust by atan(steering / throttle), "
                "so the gains hold at the throttle of the experiment, taken to be "
                f"{self._throttle(settings, speed):.0%} of full (from CRUISE_THROTTLE and CRUISE_SPEED), and elsewhere "
                "as long as thrust grows in proportion to throttle; without throttle there is no steering"
            ]
        turn = math.degrees(abs(model.steady_velocity(1.0)))
        seen = f"identified in MANUAL at {speed:.2f} m/s, where full steering turns {turn:.0f} deg/s"
        if not self.integral_grows(settings, speed):
            return [
                f"{seen}; that is not above MOT_SPD_SCA_BASE = {base:g} m/s: there the autopilot does not scale the "
                "steering and its integral cannot grow, so wind or trim leaves an error; the margins are given for "
                "just above that speed; prove the gains again when going faster"
            ]
        ideal = model.equivalent_drag(model.steady_velocity(0.5)) / self.scale(settings, speed)
        return [
            f"{seen}; above MOT_SPD_SCA_BASE = {base:g} m/s the autopilot divides the steering by speed, so the gains "
            f"hold there as long as the turn rate per rudder grows in proportion to speed: {FF} = 1/(K base) = "
            f"{ideal:.3g} then follows turn rates exactly, at every speed; at or below {base:g} m/s the integral term "
            "is frozen"
        ]

    def _feed_notes(self, model: SingleDof, settings: Settings, speed: float | None) -> list[str]:
        ideal = model.equivalent_drag(model.steady_velocity(0.5)) / self.scale(settings, speed)
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


def most_feed_forward(model: SingleDof, settings: Settings, speed: float | None) -> Mapping[str, float]:
    """Return the largest feed-forward worth offering on *model* at *speed* [m/s], by its name."""
    ideal = model.equivalent_drag(model.steady_velocity(0.5)) / RoverHeading().scale(settings, speed)
    return {FF: MOST_FEED * ideal} if ideal > 0.0 else {}
