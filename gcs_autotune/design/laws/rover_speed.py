"""ArduRover's speed loop: cruise feed-forward, FF and PID on an acceleration-limited speed, slewed and bent throttle.

``throttle = v_d CRUISE_THROTTLE/CRUISE_SPEED + FF v_d + P e + I int(e) + D de/dt``; the speed comes from the position
estimate, unfiltered. What is told as position is the speed, less that at the start of the step.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.design.actuator import Actuator, ActuatorStep
from gcs_autotune.design.laws.kernel import (
    Cutoffs,
    HeldVelocity,
    LoopPlant,
    actuate,
    advance,
    clip,
    compiled,
    delayed,
    smoothing,
)
from gcs_autotune.design.laws.law import Settings
from gcs_autotune.design.laws.loops import VelocityLoop, holding, local_drag
from gcs_autotune.design.laws.rover_throttle import pulse_of, shape, throttle_of, throttle_shape
from gcs_autotune.design.open_loop import Rational, pid_path
from gcs_autotune.design.result import ReferenceModel
from gcs_autotune.errors import NoGainsMeetSpec
from gcs_autotune.models import SingleDof

__all__ = ["CRUISE", "RoverSpeed"]

P, I, D, FF = "ATC_SPEED_P", "ATC_SPEED_I", "ATC_SPEED_D", "ATC_SPEED_FF"  # noqa: E741 - the integral gain
CRUISE = ("CRUISE_SPEED", "CRUISE_THROTTLE")
NEARLY_FULL = 0.98
"""A speed that needs more than this of full output is treated as needing this."""
NUDGE = 0.01
Array = NDArray[np.float64]


class _Gains(NamedTuple):
    """In the order of ``vector``."""

    kp: float
    ki: float
    kd: float
    kff: float


class _Limits(NamedTuple):
    """See ``limits``; a switch acts above 0."""

    imax: float
    up: float
    down: float
    brakes: float
    slew: float
    most: float
    least: float
    expo: float
    cruise: float


def _fly(
    gains: _Gains,
    limits: _Limits,
    cutoffs: Cutoffs,
    plant: LoopPlant,
    actuator: ActuatorStep,
    start: HeldVelocity,
    position: Array,
    output: Array,
) -> None:
    kp, ki, kd, kff = gains.kp, gains.ki, gains.kd, gains.kff
    imax, up, down, brakes, slew = limits.imax, limits.up, limits.down, limits.brakes > 0.0, limits.slew
    most, least, expo, cruise = limits.most, limits.least, limits.expo, limits.cruise
    dt, late, step, push, push_at, step_at = plant.dt, plant.late, plant.step, plant.push, plant.push_at, plant.step_at
    back_at = plant.back_at
    f_t, f_e, f_d = smoothing(cutoffs.target, dt), smoothing(cutoffs.error, dt), smoothing(cutoffs.slope, dt)
    v0, throttle, before = start.velocity, start.output, int(start.before)
    v = desired = target = v0
    x = error = slope = 0.0
    trim = shape(throttle, least, expo)
    integral = clip(throttle - (cruise + kff) * v0, -imax, imax) if (before > 0 and ki > 0.0) else 0.0
    limited = False
    memory = np.zeros(4)
    sent = np.empty(before + len(position))
    for j in range(len(sent)):
        k = j - before
        if k >= 0:
            position[k] = v - v0
        aim = v0 + step if step_at <= k < back_at else v0
        rate = down if (abs(aim) < abs(desired) and down > 0.0) else up
        desired = clip(aim, desired - rate * dt, desired + rate * dt) if rate > 0.0 else aim
        target += f_t * (desired - target)
        last = error
        error += f_e * (target - v - error)
        slope += f_d * ((error - last) / dt - slope)
        if not limited or integral * error < 0.0:
            integral = clip(integral + ki * error * dt, -imax, imax) if ki > 0.0 else 0.0
        wish = cruise * desired + kff * target + kp * error + integral + kd * slope
        held = False
        if not brakes and ((desired >= 0.0 and wish <= 0.0) or (desired <= 0.0 and wish >= 0.0)):
            wish, held = 0.0, True
        free = clip(wish, -most, most)
        throttle = clip(free, throttle - slew, throttle + slew) if slew > 0.0 else free
        limited = held or throttle != free or abs(throttle) >= most
        pulse = shape(throttle, least, expo)
        sent[j] = pulse
        if k >= 0:
            output[k] = pulse
        applied = actuate(delayed(sent, j, late, trim), actuator, memory)
        x, v = advance(x, v, applied + (push if k >= push_at else 0.0), plant)


FIXED: Settings = {D: 0.0, FF: 0.0}
DEFAULTS: Settings = {
    "ATC_SPEED_IMAX": 1.0,
    "ATC_SPEED_FLTT": 0.0,
    "ATC_SPEED_FLTE": 10.0,
    "ATC_SPEED_FLTD": 0.0,
    "ATC_ACCEL_MAX": 1.0,
    "ATC_DECEL_MAX": 0.0,
    "ATC_BRAKE": 1.0,
    "MOT_SLEWRATE": 100.0,
    "MOT_THR_MAX": 100.0,
    "MOT_THR_MIN": 0.0,
    "MOT_THST_EXPO": 0.0,
    "SCHED_LOOP_RATE": 50.0,
}


class RoverSpeed(VelocityLoop):
    """``Axis.law == "rover-speed"``."""

    name = "rover-speed"
    tuned: Sequence[str] = (P, I)
    integral = I
    fixed: Settings = FIXED
    measured: Sequence[str] = CRUISE
    usual_step = 0.5
    hold = 15.0
    defaults: Settings = DEFAULTS
    kernel = staticmethod(compiled(_fly))
    gains = _Gains
    vector: Sequence[str] = (P, I, D, FF)
    filters: Sequence[str] = ("ATC_SPEED_FLTT", "ATC_SPEED_FLTE", "ATC_SPEED_FLTD")

    def velocity_limit(self, settings: Settings, speed: float | None) -> float:
        """Return ATC_ACCEL_MAX [m/s^2]."""
        most = self._get(settings, "ATC_ACCEL_MAX")
        return most if most > 0.0 else math.inf

    def cruise(self, settings: Settings) -> float:
        """Return the throttle [fraction] that the feed-forward gives per m/s; 0 when it is off."""
        speed, percent = (settings.get(name, 0.0) for name in CRUISE)
        return percent / 100.0 / speed if speed > 0.0 and percent > 0.0 else 0.0

    def throttle_for(self, model: SingleDof, actuator: Actuator, settings: Settings, velocity: float) -> float:
        """Return the throttle [fraction] that keeps *velocity* [m/s], full where that is not enough."""
        force = holding(model, velocity)
        try:
            pulse = actuator.output_for(min(force, NEARLY_FULL))
        except NoGainsMeetSpec:
            pulse = math.copysign(NEARLY_FULL, force)
        return throttle_of(pulse, settings)

    def slopes(
        self, actuator: Actuator, model: SingleDof, step: float, settings: Settings, speed: float | None
    ) -> tuple[float, ...]:
        """Return force per throttle at both ends of the step, with the battery fresh and weak."""
        found = set()
        for velocity in (self.base(step, speed), self.base(step, speed) + step):
            throttle = self.throttle_for(model, actuator, settings, velocity)
            pulses = np.array([pulse_of(max(throttle + way * NUDGE, 0.0), settings) for way in (-1.0, 1.0)])
            low, high = actuator.static(pulses)
            gain = (high - low) / (NUDGE + min(throttle, NUDGE))
            found |= {round(max(gain, 1e-3) * weak, 6) for weak in {1.0, actuator.weakest}}
        return tuple(sorted(found))

    def starts(
        self, model: SingleDof, wanted: ReferenceModel, settings: Settings, speed: float | None
    ) -> list[dict[str, float]]:
        """Match ``alpha s + drag`` under PI: damping ``2/a1``, stiffness ``1/a1^2``; and half as quick."""
        velocity = self.base(self.usual_step, speed)
        drag = local_drag(model, velocity)
        found = []
        for quickness in (2.0, 1.0):
            rate = quickness / wanted.a1
            found.append({P: max(2.0 * model.alpha * rate - drag, 0.05 * drag), I: model.alpha * rate * rate})
        return found

    def holding_output(self, model: SingleDof, actuator: Actuator, settings: Settings, velocity: float) -> float:
        """Return :meth:`throttle_for`: the loop's output is throttle, not force."""
        return self.throttle_for(model, actuator, settings, velocity)

    def limits(self, settings: Settings, speed: float | None, dt: float) -> _Limits:
        """Return IMAX, both accelerations, whether it brakes, slew a loop, most and least throttle, bend, cruise."""
        least, expo = throttle_shape(settings)
        return _Limits(
            imax=self._get(settings, "ATC_SPEED_IMAX"),
            up=self._get(settings, "ATC_ACCEL_MAX"),
            down=self._get(settings, "ATC_DECEL_MAX"),
            brakes=self._get(settings, "ATC_BRAKE"),
            slew=self._get(settings, "MOT_SLEWRATE") / 100.0 * dt,
            most=self._get(settings, "MOT_THR_MAX") / 100.0,
            least=least,
            expo=expo,
            cruise=self.cruise(settings),
        )

    def controller(self, settings: Settings, speed: float | None) -> Rational:
        """Return measured speed to throttle."""
        return pid_path(
            settings[P],
            settings[I],
            settings[D],
            error_cutoff=self._get(settings, "ATC_SPEED_FLTE"),
            slope_cutoff=self._get(settings, "ATC_SPEED_FLTD"),
        )

    def integral_rate(self, settings: Settings, speed: float | None) -> float:
        """Return ``I / (P + c)``, with the cruise pair's throttle per m/s ``c`` standing for the craft's own drag."""
        return settings[I] / max(settings[P] + self.cruise(settings), 1e-12)

    def notes(self, model: SingleDof, settings: Settings, speed: float | None) -> list[str]:
        """Say what the cruise pair does besides, and where the gains hold."""
        speed_now, percent = (settings.get(name, math.nan) for name in CRUISE)
        return [
            f"the pair CRUISE_SPEED {speed_now:.3g} m/s, CRUISE_THROTTLE {percent:.0f} % is the loop's feed-forward; "
            "it also says what a full stick asks for in ACRO and STEERING (CRUISE_SPEED x 100 / CRUISE_THROTTLE)",
            "the model was found in calm water on this load: head wind, current and payload are left to the integral",
        ]
