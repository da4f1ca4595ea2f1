"""ArduSub's depth loop: square-root position controller, climb-rate P/I, acceleration P/I/FF, filtered throttle.

In SI and down positive: ``Z = 0.2 * LPF_2Hz(ACCZ (a_t - a) + FF a_t) - 2 (hover - 0.5)``; the 0.2 is
the autopilot's 0.001 per cm/s^2, times 100 cm, times 2 because throttle 0..1 means -1..1.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.design.actuator import ActuatorStep
from gcs_autotune.design.laws.kernel import (
    MAX_STANDING_ERROR,
    LoopPlant,
    actuate,
    advance,
    clip,
    compiled,
    delayed,
    smoothing,
    sqrt_control,
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
)
from gcs_autotune.design.result import ReferenceModel
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
"""New in 4.7; before, nothing limited the thrust there."""
OUTPUT = 0.2
"""Output fraction per m/s^2 of the acceleration controller."""
THROTTLE_CUTOFF = 2.0
"""POSCONTROL_THROTTLE_CUTOFF_FREQ_HZ [Hz]."""


class _Gains(NamedTuple):
    """In the order of ``vector``."""

    pos: float
    vel: float
    vel_i: float
    acc: float
    acc_i: float
    acc_ff: float


class _Limits(NamedTuple):
    """See ``limits``; a switch acts above 0."""

    v_max: float
    a_max: float
    vel_imax: float
    imax: float
    hover: float


class _Cutoffs(NamedTuple):
    """In the order of ``filters`` [Hz]."""

    velocity: float
    target: float
    error: float


def _fly(
    gains: _Gains,
    limits: _Limits,
    cutoffs: _Cutoffs,
    plant: LoopPlant,
    actuator: ActuatorStep,
    position: NDArray[np.float64],
    output: NDArray[np.float64],
) -> None:
    pos, vel, vel_i, acc, acc_i, acc_ff = gains.pos, gains.vel, gains.vel_i, gains.acc, gains.acc_i, gains.acc_ff
    v_max, a_max, vel_imax, imax, hover = limits.v_max, limits.a_max, limits.vel_imax, limits.imax, limits.hover
    dt, late, step, push, push_at = plant.dt, plant.late, plant.step, plant.push, plant.push_at
    step_at, rest, back_at = plant.step_at, plant.settled, plant.back_at
    f_v, f_t, f_e = smoothing(cutoffs.velocity, dt), smoothing(cutoffs.target, dt), smoothing(cutoffs.error, dt)
    f_u = smoothing(THROTTLE_CUTOFF, dt)
    w = a = v_integral = 0.0
    integral = clip(-rest + hover, -imax, imax) if acc_i > 0.0 else 0.0
    a_target = a_error = -(rest - hover + integral) / max(OUTPUT * (acc + acc_ff), 1e-9)
    v_error = a_target / max(vel, 1e-9)
    z = clip(-v_error / max(pos, 1e-9), -MAX_STANDING_ERROR, MAX_STANDING_ERROR)
    thrust = trim = clip(OUTPUT * (acc + acc_ff) * a_target + integral - hover, -1.0, 1.0)
    limited = False
    memory = np.zeros(4)
    for k in range(len(position)):
        position[k] = z
        aim = step if step_at <= k < back_at else 0.0
        wish = clip(sqrt_control(aim - z, pos, a_max), -v_max, v_max)
        v_error += f_v * (wish - w - v_error)
        if not limited or v_integral * v_error < 0.0:
            v_integral = clip(v_integral + vel_i * v_error * dt, -vel_imax, vel_imax)
        demand = vel * v_error + v_integral
        a_target += f_t * (demand - a_target)
        a_error += f_e * (a_target - a - a_error)
        if not limited or integral * a_error < 0.0:
            integral = clip(integral + OUTPUT * acc_i * a_error * dt, -imax, imax)
        u = OUTPUT * (acc * a_error + acc_ff * a_target) + integral - hover
        thrust += f_u * (clip(u, -1.0, 1.0) - thrust)
        limited = abs(thrust) >= 0.999
        output[k] = thrust
        applied = actuate(delayed(output, k, late, trim), actuator, memory)
        was = w
        z, w = advance(z, w, applied + (push if k >= push_at else 0.0), plant)
        a = (w - was) / dt


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
    """``Axis.law == "sub-depth"``."""

    name = "sub-depth"
    tuned: Sequence[str] = (POS, VEL, ACC, ACC_I, ACC_FF)
    integral = ACC_I
    fixed: Settings = FIXED
    usual_step = 1.0
    defaults: Settings = DEFAULTS
    kernel = staticmethod(compiled(_fly))
    gains = _Gains
    cutoffs = _Cutoffs
    vector: Sequence[str] = (POS, VEL, VEL_I, ACC, ACC_I, ACC_FF)
    filters: Sequence[str] = ("PSC_VELZ_FLTE", "PSC_ACCZ_FLTT", "PSC_ACCZ_FLTE")

    def velocity_limit(self, settings: Settings, speed: float | None) -> float:
        """Return the lesser of the pilot's climb and descent speeds [m/s]."""
        up = self._get(settings, "PILOT_SPEED_UP") / 100.0
        down = self._get(settings, "PILOT_SPEED_DN") / 100.0
        return min(up, down) if down > 0.0 else up

    def starts(
        self, model: SingleDof, wanted: ReferenceModel, settings: Settings, speed: float | None
    ) -> list[dict[str, float]]:
        """Match coefficients of the cascade without filters, ACCZ_P given.

        With ``M = alpha + 0.2 Pa`` and ``X = 0.2 Ia Pv Pz``: ``a3 = M/X``, ``a2 = (beta + 0.2 Pa Pv + 0.2 Ia)/X``,
        ``a1 = Pa/Ia + 1/Pz``; eliminating all but ``y = Pa/Ia`` leaves a cubic.
        """
        drag = model.equivalent_drag(self.usual_step / wanted.a1)
        found = [_cascade(model.alpha, drag, wanted, pa) for pa in (0.5, 1.0)]
        gentle = {POS: 2.0 / wanted.a1, VEL: 8.0 / wanted.a1, ACC: 1.0, ACC_I: 1.0, ACC_FF: 0.0}
        return [*(f for f in found if f), gentle]

    def limits(self, settings: Settings, speed: float | None, dt: float) -> _Limits:
        """Return speed, acceleration, both integrals' most, and the throttle offset of the hover."""
        hover = self._get(settings, "MOT_THST_HOVER")
        return _Limits(
            v_max=self.velocity_limit(settings, speed),
            a_max=self._get(settings, "PILOT_ACCEL_Z") / 100.0,
            vel_imax=self._get(settings, "PSC_VELZ_IMAX") / 100.0,
            imax=2e-3 * max(self._get(settings, "PSC_ACCZ_IMAX"), 1e3 * hover),
            hover=2.0 * (hover - 0.5),
        )

    def _parts(self, settings: Settings) -> tuple[Rational, Rational, Rational]:
        """Acceleration to output (feedback; feed-forward), and climb rate to wanted acceleration."""
        throttle = first_order(THROTTLE_CUTOFF) * constant(OUTPUT)
        pid = pid_path(settings[ACC], settings[ACC_I], error_cutoff=self._get(settings, "PSC_ACCZ_FLTE")) * throttle
        velocity = pid_path(settings[VEL], settings[VEL_I], error_cutoff=self._get(settings, "PSC_VELZ_FLTE"))
        feed = constant(settings[ACC_FF]) * throttle
        return pid, feed, velocity * first_order(self._get(settings, "PSC_ACCZ_FLTT"))

    def controller(self, settings: Settings, speed: float | None) -> Rational:
        """Return climb rate to output, the position controller in its linear range."""
        pid, feed, velocity = self._parts(settings)
        wish = velocity * (constant(1.0) + integrator(settings[POS]))
        slope = Rational(np.array([1.0, 0.0]), np.array([1.0]))
        return pid * (wish + slope) + feed * wish

    def position_path(self, settings: Settings, speed: float | None) -> Rational:
        """Return measured depth to output."""
        pid, feed, velocity = self._parts(settings)
        return (pid + feed) * velocity * constant(settings[POS])

    def integral_rate(self, settings: Settings, speed: float | None) -> float:
        """Return ``Pz Ia / (Pz (Pa + FF) + Ia)``."""
        return integral_over_proportional(settings[POS], settings[ACC] + settings[ACC_FF], settings[ACC_I])

    def notes(self, model: SingleDof, settings: Settings, speed: float | None) -> list[str]:
        """Say what the gains do not cover."""
        notes = []
        if SURFACE in settings:
            notes.append(f"near the surface ArduSub limits the upward thrust ({SURFACE}); prove the gains below it")
        if self._get(settings, "PSC_ACCZ_D") != 0.0:
            notes.append("PSC_ACCZ_D is not zero; the design leaves it alone and does not model it")
        return notes


def _cascade(alpha: float, drag: float, wanted: ReferenceModel, pa: float) -> dict[str, float]:
    """Solve the cubic for the smallest ``y`` in (0, a1); empty when there is none."""
    x = (alpha + OUTPUT * pa) / wanted.a3
    roots = np.roots([-x, wanted.a1 * x, drag - wanted.a2 * x, OUTPUT * pa])
    real = roots.real[np.abs(roots.imag) < 1e-9]
    fit = np.sort(real[(real > 0.0) & (real < 0.999 * wanted.a1)])
    if not len(fit):
        return {}
    y = float(fit[0])
    ia, pz = pa / y, 1.0 / (wanted.a1 - y)
    return {POS: pz, VEL: x / (OUTPUT * ia * pz), ACC: pa, ACC_I: ia, ACC_FF: 0.0}
