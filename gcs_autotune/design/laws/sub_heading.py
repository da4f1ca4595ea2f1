"""ArduSub's heading loop: shaped target, square-root angle controller, yaw-rate P/I/D.

``N = P e + I int(e) + D de/dt`` with ``e = LPF(r_t) - r``. Sub reads ATC_RAT_YAW_FF and never uses it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from gcs_autotune.control import ReferenceModel
from gcs_autotune.design.laws.kernel import Cascade
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
from gcs_autotune.models import SingleDof

__all__ = ["SubHeading"]

P, I, D, ANG = "ATC_RAT_YAW_P", "ATC_RAT_YAW_I", "ATC_RAT_YAW_D", "ATC_ANG_YAW_P"  # noqa: E741
ACCELERATION = (math.radians(10.0), math.radians(120.0))
"""Bounds of the angle controller's deceleration [rad/s^2].

The deceleration is half of ATC_ACCEL_Y_MAX, limited to these bounds; it is unlimited if that parameter is 0.
"""
ERROR_MAX = math.radians(45.0)
"""Largest lead of the target over the craft [rad]; beyond it the target is pulled back."""


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
    """Control law ``Axis.law == "sub-heading"``."""

    name = "sub-heading"
    tuned: Sequence[str] = (P, I, ANG)
    integral = I
    fixed: Settings = FIXED
    usual_step = math.radians(30.0)
    defaults: Settings = DEFAULTS
    gyro = "INS_GYRO_FILTER"

    def _rate_max(self, settings: Settings) -> float:
        rate = math.radians(self._get(settings, "ATC_RATE_Y_MAX"))
        return rate if rate > 0.0 else 1e6

    def velocity_limit(self, settings: Settings, speed: float | None) -> float:
        """Return the smaller of ATC_RATE_Y_MAX and ATC_SLEW_YAW [rad/s]."""
        return min(self._rate_max(settings), math.radians(self._get(settings, "ATC_SLEW_YAW") / 100.0))

    def starts(
        self, model: SingleDof, wanted: ReferenceModel, settings: Settings, speed: float | None
    ) -> list[dict[str, float]]:
        """Match the coefficients ``a3 = alpha/(I A)``, ``a2 = (beta + P)/(I A)``, ``a1 = 1/A + P/I``.

        If the quadratic equation in A has no real root, its real part is used. The second start omits the integral:
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

    def cascade(self, settings: Settings, speed: float | None, dt: float) -> Cascade:
        """Return the result of :meth:`angle_loop`, with a target that moves within slew rate and time constant."""
        return self.angle_loop(settings)._replace(
            on_position=1.0,
            angle=1.0,
            slew=math.radians(self._get(settings, "ATC_SLEW_YAW") / 100.0),
            shape_time=max(self._get(settings, "ATC_INPUT_TC"), 0.01),
        )

    def angle_loop(self, settings: Settings) -> Cascade:
        """Return the moving target, the angle controller and the rate PID; the yaw stick uses the same stages."""
        kp, ki, kd, angle = (settings.get(name, 0.0) for name in (P, I, D, ANG))
        shape = math.radians(self._get(settings, "ATC_ACCEL_Y_MAX") / 100.0)
        return Cascade(
            position_p=angle,
            sqrt_acceleration=min(max(0.5 * shape, ACCELERATION[0]), ACCELERATION[1]) if shape > 0.0 else 0.0,
            leads=1.0,
            lead_max=ERROR_MAX,
            shaped=self._get(settings, "ATC_RATE_FF_ENAB"),
            shape_acceleration=self.shaping(settings),
            velocity_max=self._rate_max(settings),
            p=kp,
            i=ki,
            d=kd,
            imax=self._get(settings, "ATC_RAT_YAW_IMAX"),
            target_cutoff=self._get(settings, "ATC_RAT_YAW_FLTT"),
            error_cutoff=self._get(settings, "ATC_RAT_YAW_FLTE"),
            slope_cutoff=self._get(settings, "ATC_RAT_YAW_FLTD"),
        )

    def shaping(self, settings: Settings) -> float:
        """Return the largest acceleration of the target, ATC_ACCEL_Y_MAX [rad/s^2]."""
        most = math.radians(self._get(settings, "ATC_ACCEL_Y_MAX") / 100.0)
        return most if most > 0.0 else 1e6

    def _parts(self, settings: Settings) -> tuple[Rational, Rational]:
        """Return two transfer functions: the PID (turn rate to output), and the angle loop (heading to turn rate)."""
        pid = pid_path(
            settings[P],
            settings[I],
            settings[D],
            error_cutoff=self._get(settings, "ATC_RAT_YAW_FLTE"),
            slope_cutoff=self._get(settings, "ATC_RAT_YAW_FLTD"),
        )
        return pid, first_order(self._get(settings, "ATC_RAT_YAW_FLTT")) * constant(settings[ANG])

    def controller(self, settings: Settings, speed: float | None) -> Rational:
        """Return the transfer function from measured turn rate to output, with the angle controller in its linear
        range."""
        pid, angle = self._parts(settings)
        return pid * (angle * integrator() + second_order(self._get(settings, self.gyro)))

    def position_path(self, settings: Settings, speed: float | None) -> Rational:
        """Return the transfer function from measured heading to output."""
        pid, angle = self._parts(settings)
        return pid * angle

    def integral_rate(self, settings: Settings, speed: float | None) -> float:
        """Return the rate ``A I / (A P + I)``."""
        return integral_over_proportional(settings[ANG], settings[P], settings[I])

    def notes(self, model: SingleDof, settings: Settings, speed: float | None) -> list[str]:
        """Return notes on conditions for which the gains are not designed."""
        return ["the yaw model was identified without headway. ArduSub does not scale its yaw gains with speed"]
