"""ArduRover's speed loop: cruise feed-forward, FF and PID on an acceleration-limited speed, with a shaped throttle.

``throttle = v_d CRUISE_THROTTLE/CRUISE_SPEED + FF v_d + P e + I int(e) + D de/dt``. The speed comes from the position
estimate, unfiltered. The speed relative to the start of the step replaces the position.

All values from throttle to servo pulse are fractions of full. The firmware first raises the throttle above MOT_THR_MIN
and then applies the thrust curve. For ``e = MOT_THST_EXPO``, the thrust ``(1 - e) u + e u^2`` of the pulse is then
proportional to the throttle.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.control import ReferenceModel
from gcs_autotune.design.actuator import Actuator
from gcs_autotune.design.laws.kernel import Cascade, shaped_throttle
from gcs_autotune.design.laws.law import Settings, setting
from gcs_autotune.design.laws.loops import VelocityLoop, holding, local_drag
from gcs_autotune.design.open_loop import Rational, pid_path
from gcs_autotune.errors import NoGainsMeetSpec
from gcs_autotune.models import SingleDof

__all__ = ["CRUISE", "RoverSpeed", "pulse_of", "throttle_of", "throttle_shape"]

P, I, D, FF = "ATC_SPEED_P", "ATC_SPEED_I", "ATC_SPEED_D", "ATC_SPEED_FF"  # noqa: E741 - the integral gain
CRUISE = ("CRUISE_SPEED", "CRUISE_THROTTLE")
NEARLY_FULL = 0.98
"""Output [fraction of full] above which a speed is treated as needing full output. Project choice."""
NUDGE = 0.01
Array = NDArray[np.float64]


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


def throttle_shape(settings: Settings) -> tuple[float, float]:
    """Return the minimum pulse [fraction] and the exponent of the thrust curve (MOT_THST_EXPO) in *settings*."""
    return setting(settings, DEFAULTS, "MOT_THR_MIN") / 100.0, setting(settings, DEFAULTS, "MOT_THST_EXPO")


def pulse_of(throttle: float, settings: Settings) -> float:
    """Return the pulse [fraction] that the firmware sends for *throttle* [fraction]."""
    return shaped_throttle(throttle, *throttle_shape(settings))


def throttle_of(pulse: float, settings: Settings) -> float:
    """Return the throttle [fraction] for which the firmware sends *pulse* [fraction].

    This is the inverse of :func:`pulse_of`.
    """
    least, expo = throttle_shape(settings)
    size = abs(pulse)
    if expo != 0.0 and -1.0 <= expo <= 1.0:
        size = (1.0 - expo) * size + expo * size * size
    size = max(size - least, 0.0) / max(1.0 - least, 1e-9)
    return math.copysign(size, pulse)


class RoverSpeed(VelocityLoop):
    """Control law ``rover-speed`` (``Axis.law``): ArduRover's speed loop."""

    name = "rover-speed"
    tuned: Sequence[str] = (P, I)
    integral = I
    fixed: Settings = FIXED
    measured: Sequence[str] = CRUISE
    usual_step = 0.5
    hold = 15.0
    defaults: Settings = DEFAULTS

    def velocity_limit(self, settings: Settings, speed: float | None) -> float:
        """Return the acceleration limit ATC_ACCEL_MAX [m/s^2]."""
        most = self._get(settings, "ATC_ACCEL_MAX")
        return most if most > 0.0 else math.inf

    def cruise(self, settings: Settings) -> float:
        """Return the throttle [fraction] per m/s of the cruise feed-forward, or 0 if it is off."""
        speed, percent = (settings.get(name, 0.0) for name in CRUISE)
        return percent / 100.0 / speed if speed > 0.0 and percent > 0.0 else 0.0

    def throttle_for(self, model: SingleDof, actuator: Actuator, settings: Settings, velocity: float) -> float:
        """Return the throttle [fraction] that keeps *model* at *velocity* [m/s], limited to full throttle."""
        force = holding(model, velocity)
        try:
            pulse = actuator.output_for(min(force, NEARLY_FULL))
        except NoGainsMeetSpec:
            pulse = math.copysign(NEARLY_FULL, force)
        return throttle_of(pulse, settings)

    def slopes(
        self, actuator: Actuator, model: SingleDof, step: float, settings: Settings, speed: float | None
    ) -> tuple[float, ...]:
        """Return the slopes of force over throttle at the speeds before and after the step, with a fresh and with a
        weak battery.
        """
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
        """Return PI gains for the plant ``alpha s + drag``, with damping ``2/a1`` and stiffness ``1/a1^2``.

        A second set is half as fast.
        """
        velocity = self.base(self.usual_step, speed)
        drag = local_drag(model, velocity)
        found = []
        for quickness in (2.0, 1.0):
            rate = quickness / wanted.a1
            found.append({P: max(2.0 * model.alpha * rate - drag, 0.05 * drag), I: model.alpha * rate * rate})
        return found

    def holding_output(self, model: SingleDof, actuator: Actuator, settings: Settings, velocity: float) -> float:
        """Return the result of :meth:`throttle_for`, because the loop's output is throttle, not force."""
        return self.throttle_for(model, actuator, settings, velocity)

    def output_behind(self, settings: Settings, sent: float) -> float:
        """Return the throttle [fraction] for which the firmware sends *sent* [fraction]."""
        return throttle_of(sent, settings)

    def cascade(self, settings: Settings, speed: float | None, dt: float) -> Cascade:
        """Return the stages: both accelerations, PID and cruise, braking, slew rate, throttle limits, thrust curve."""
        least, expo = throttle_shape(settings)
        kff, kp, ki, kd = (settings.get(name, 0.0) for name in (FF, P, I, D))
        return Cascade(
            acceleration=self._get(settings, "ATC_ACCEL_MAX"),
            deceleration=self._get(settings, "ATC_DECEL_MAX"),
            ff=kff,
            p=kp,
            i=ki,
            d=kd,
            imax=self._get(settings, "ATC_SPEED_IMAX"),
            target_cutoff=self._get(settings, "ATC_SPEED_FLTT"),
            error_cutoff=self._get(settings, "ATC_SPEED_FLTE"),
            slope_cutoff=self._get(settings, "ATC_SPEED_FLTD"),
            cruise=self.cruise(settings),
            brakes=self._get(settings, "ATC_BRAKE"),
            slew_output=self._get(settings, "MOT_SLEWRATE") / 100.0 * dt,
            most=self._get(settings, "MOT_THR_MAX") / 100.0,
            least=least,
            expo=expo,
        )

    def controller(self, settings: Settings, speed: float | None) -> Rational:
        """Return the transfer function from measured speed to throttle."""
        return pid_path(
            settings[P],
            settings[I],
            settings[D],
            error_cutoff=self._get(settings, "ATC_SPEED_FLTE"),
            slope_cutoff=self._get(settings, "ATC_SPEED_FLTD"),
        )

    def integral_rate(self, settings: Settings, speed: float | None) -> float:
        """Return the rate [1/s] ``I / (P + c)``.

        ``c`` is the throttle per m/s of CRUISE_THROTTLE and CRUISE_SPEED, and represents the craft's own drag.
        """
        return settings[I] / max(settings[P] + self.cruise(settings), 1e-12)

    def notes(self, model: SingleDof, settings: Settings, speed: float | None) -> list[str]:
        """Return notes on other uses of CRUISE_SPEED and CRUISE_THROTTLE, and on the validity of the gains."""
        speed_now, percent = (settings.get(name, math.nan) for name in CRUISE)
        return [
            f"CRUISE_SPEED {speed_now:.3g} m/s and CRUISE_THROTTLE {percent:.0f} % together are the loop's "
            "feed-forward. They also set the speed at full stick in ACRO and STEERING (CRUISE_SPEED x 100 / "
            "CRUISE_THROTTLE)",
            "the model is valid for calm water and this load. The integral gain corrects for head wind, current and "
            "payload",
        ]
