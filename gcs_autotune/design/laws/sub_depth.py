"""ArduSub's depth loop: square-root position controller, climb-rate P/I, acceleration P/I/FF, filtered throttle.

In SI units, down positive: ``Z = 0.2 * LPF_2Hz(ACCZ (a_t - a) + FF a_t) - 2 (hover - 0.5)``. The factor 0.2 is the
autopilot's 0.001 per cm/s^2, times 100 cm, times 2 because throttle 0..1 means -1..1.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

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
)
from gcs_autotune.models import SingleDof

__all__ = ["SubDepth"]

POS, VEL, VEL_I, ACC, ACC_I, ACC_FF = (
    "PSC_POSZ_P",
    "PSC_VELZ_P",
    "PSC_VELZ_I",
    "PSC_ACCZ_P",
    "PSC_ACCZ_I",
    "PSC_ACCZ_FF",
)
SURFACE = "SURFACE_MAX_THR"
"""Name of the parameter that limits the thrust at the surface.

It is new in ArduSub 4.7; earlier versions have no such limit.
"""
OUTPUT = 0.2
"""Output [fraction] per m/s^2 of the acceleration controller."""
THROTTLE_CUTOFF = 2.0
"""Cut-off frequency of the throttle's low-pass: POSCONTROL_THROTTLE_CUTOFF_FREQ_HZ [Hz]."""


FIXED: Settings = {VEL_I: 0.0}
DEFAULTS: Settings = {
    "PSC_VELZ_IMAX": 1000.0,
    "PSC_VELZ_FLTE": 5.0,
    "PSC_ACCZ_D": 0.0,
    "PSC_ACCZ_IMAX": 800.0,
    "PSC_ACCZ_FLTT": 0.0,
    "PSC_ACCZ_FLTE": 20.0,
    "MOT_THST_HOVER": 0.5,
    "PILOT_SPEED_UP": 200.0,
    "PILOT_SPEED_DN": 0.0,
    "PILOT_ACCEL_Z": 200.0,
    "SCHED_LOOP_RATE": 400.0,
}


class SubDepth(PositionLoop):
    """Control law ``sub-depth`` (``Axis.law``): ArduSub's depth loop."""

    name = "sub-depth"
    tuned: Sequence[str] = (POS, VEL, ACC, ACC_I, ACC_FF)
    integral = ACC_I
    fixed: Settings = FIXED
    usual_step = 1.0
    defaults: Settings = DEFAULTS

    def velocity_limit(self, settings: Settings, speed: float | None) -> float:
        """Return the smaller of the pilot's climb and descent speeds [m/s]."""
        up = self._get(settings, "PILOT_SPEED_UP") / 100.0
        down = self._get(settings, "PILOT_SPEED_DN") / 100.0
        return min(up, down) if down > 0.0 else up

    def starts(
        self, model: SingleDof, wanted: ReferenceModel, settings: Settings, speed: float | None
    ) -> list[dict[str, float]]:
        """Return gains that match the coefficients of the cascade without filters to *wanted*, for the ACCZ_P in
        *settings*.

        Let ``M = alpha + 0.2 Pa`` and ``X = 0.2 Ia Pv Pz``. The coefficients are ``a3 = M/X``,
        ``a2 = (beta + 0.2 Pa Pv + 0.2 Ia)/X``, ``a1 = Pa/Ia + 1/Pz``. Elimination of all unknowns except ``y = Pa/Ia``
        gives a cubic equation.
        """
        drag = model.equivalent_drag(self.usual_step / wanted.a1)
        found = [_cascade(model.alpha, drag, wanted, pa) for pa in (0.5, 1.0)]
        gentle = {POS: 2.0 / wanted.a1, VEL: 8.0 / wanted.a1, ACC: 1.0, ACC_I: 1.0, ACC_FF: 0.0}
        return [*(f for f in found if f), gentle]

    def cascade(self, settings: Settings, speed: float | None, dt: float) -> Cascade:
        """Return the stages: square-root controller, climb-rate PI, acceleration PI, throttle low-pass and offset."""
        hover = self._get(settings, "MOT_THST_HOVER")
        pos, vel, vel_i, acc, acc_i, acc_ff = (settings.get(n, 0.0) for n in (POS, VEL, VEL_I, ACC, ACC_I, ACC_FF))
        return Cascade(
            on_position=1.0,
            position_p=pos,
            sqrt_acceleration=self._get(settings, "PILOT_ACCEL_Z") / 100.0,
            velocity_max=self.velocity_limit(settings, speed),
            nested=1.0,
            velocity_p=vel,
            velocity_i=vel_i,
            velocity_imax=self._get(settings, "PSC_VELZ_IMAX") / 100.0,
            velocity_cutoff=self._get(settings, "PSC_VELZ_FLTE"),
            ff=OUTPUT * acc_ff,
            p=OUTPUT * acc,
            i=OUTPUT * acc_i,
            imax=2e-3 * max(self._get(settings, "PSC_ACCZ_IMAX"), 1e3 * hover),
            target_cutoff=self._get(settings, "PSC_ACCZ_FLTT"),
            error_cutoff=self._get(settings, "PSC_ACCZ_FLTE"),
            hover=2.0 * (hover - 0.5),
            output_cutoff=THROTTLE_CUTOFF,
        )

    def _parts(self, settings: Settings) -> tuple[Rational, Rational, Rational]:
        """Return two transfer functions.

        They are from acceleration to output (feedback; feed-forward), and from climb rate to acceleration demand.
        """
        throttle = first_order(THROTTLE_CUTOFF) * constant(OUTPUT)
        pid = pid_path(settings[ACC], settings[ACC_I], error_cutoff=self._get(settings, "PSC_ACCZ_FLTE")) * throttle
        velocity = pid_path(settings[VEL], settings[VEL_I], error_cutoff=self._get(settings, "PSC_VELZ_FLTE"))
        feed = constant(settings[ACC_FF]) * throttle
        return pid, feed, velocity * first_order(self._get(settings, "PSC_ACCZ_FLTT"))

    def controller(self, settings: Settings, speed: float | None) -> Rational:
        """Return the transfer function from climb rate to output, with the position controller in its linear range."""
        pid, feed, velocity = self._parts(settings)
        acceleration_demand = velocity * (constant(1.0) + integrator(settings[POS]))
        slope = Rational((1.0, 0.0), (1.0,))
        return pid * (acceleration_demand + slope) + feed * acceleration_demand

    def position_path(self, settings: Settings, speed: float | None) -> Rational:
        """Return the transfer function from measured depth to output."""
        pid, feed, velocity = self._parts(settings)
        return (pid + feed) * velocity * constant(settings[POS])

    def integral_rate(self, settings: Settings, speed: float | None) -> float:
        """Return the rate [1/s] ``Pz Ia / (Pz (Pa + FF) + Ia)``."""
        return integral_over_proportional(settings[POS], settings[ACC] + settings[ACC_FF], settings[ACC_I])

    def notes(self, model: SingleDof, settings: Settings, speed: float | None) -> list[str]:
        """Return notes on conditions for which the gains are not designed."""
        notes = []
        if SURFACE in settings:
            notes.append(
                f"near the surface ArduSub limits the upward thrust ({SURFACE}). Test the gains in deeper water"
            )
        if self._get(settings, "PSC_ACCZ_D") != 0.0:
            notes.append("PSC_ACCZ_D is not zero. The design neither changes nor models it")
        return notes


def _cascade(alpha: float, drag: float, wanted: ReferenceModel, pa: float) -> dict[str, float]:
    """Solve the cubic for the smallest ``y`` in (0, a1); return an empty result if there is none."""
    x = (alpha + OUTPUT * pa) / wanted.a3
    roots = np.roots([-x, wanted.a1 * x, drag - wanted.a2 * x, OUTPUT * pa])
    real = roots.real[np.abs(roots.imag) < 1e-9]
    fit = np.sort(real[(real > 0.0) & (real < 0.999 * wanted.a1)])
    if not len(fit):
        return {}
    y = float(fit[0])
    ia, pz = pa / y, 1.0 / (wanted.a1 - y)
    return {POS: pz, VEL: x / (OUTPUT * ia * pz), ACC: pa, ACC_I: ia, ACC_FF: 0.0}
