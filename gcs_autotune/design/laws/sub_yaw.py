"""ArduSub's turn-rate loop as a pilot feels it: the yaw stick of STABILIZE and ALT_HOLD.

No mode of ArduSub leaves the angle loop out: the stick moves a heading target at the wanted rate (shaped by
ATC_ACCEL_Y_MAX), whose rate is fed forward, and ATC_ANG_YAW_P corrects what the craft falls behind it. So that gain is
tuned with the rate PID, for the turn rate (decision 10). ``N = P e + I int(e) + D de/dt``. What is told as position is
the turn rate.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.design.actuator import ActuatorStep
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
    smoothing,
    sqrt_control,
)
from gcs_autotune.design.laws.law import Settings
from gcs_autotune.design.laws.loops import VelocityLoop
from gcs_autotune.design.laws.sub_heading import ACCELERATION, ANG, ERROR_MAX, FILTERS, FIXED, D, I, P, SubHeading
from gcs_autotune.design.laws.sub_heading import DEFAULTS as OF_HEADING
from gcs_autotune.design.open_loop import Rational
from gcs_autotune.design.result import ReferenceModel
from gcs_autotune.models import SingleDof

__all__ = ["SubYaw"]

REPAID = 0.1
"""The craft falls behind the moving target at first and turns faster to catch up: no rate gains can help that."""
UNUSED = ("ATC_SLEW_YAW", "ATC_INPUT_TC")
"""They shape headings, not rates."""
DEFAULTS: Settings = {n: v for n, v in OF_HEADING.items() if n not in UNUSED}
Array = NDArray[np.float64]


class _Gains(NamedTuple):
    """In the order of ``vector``."""

    kp: float
    ki: float
    kd: float
    ang: float


class _Limits(NamedTuple):
    """See ``limits``; a switch acts above 0."""

    imax: float
    rate_max: float
    shape_acc: float
    shaped: float
    stop_acc: float
    lead_max: float


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
    kp, ki, kd, ang = gains.kp, gains.ki, gains.kd, gains.ang
    imax, rate_max, shape_acc, shaped, stop_acc, lead_max = (
        limits.imax,
        limits.rate_max,
        limits.shape_acc,
        limits.shaped > 0.0,
        limits.stop_acc,
        limits.lead_max,
    )
    dt, late, step, push, push_at, step_at = plant.dt, plant.late, plant.step, plant.push, plant.push_at, plant.step_at
    back_at = plant.back_at
    f_t, f_e, f_d = smoothing(cutoffs.target, dt), smoothing(cutoffs.error, dt), smoothing(cutoffs.slope, dt)
    v0, trim, before = start.velocity, start.output, int(start.before)
    r = x1 = x2 = y1 = y2 = target = v0
    lead_rate = v0 if shaped else 0.0
    psi = lead = slope = error = 0.0
    integral = clip(trim, -imax, imax) if (before > 0 and ki > 0.0) else 0.0
    limited = False
    memory = np.zeros(4)
    sent = np.empty(before + len(position))
    for j in range(len(sent)):
        k = j - before
        if k >= 0:
            position[k] = r - v0
        measured = gyro.b0 * r + gyro.b1 * x1 + gyro.b2 * x2 - gyro.a1 * y1 - gyro.a2 * y2
        x2, x1, y2, y1 = x1, r, y1, measured
        wish = v0 + step if step_at <= k < back_at else v0
        if shaped:
            lead_rate = clip(wish, lead_rate - shape_acc * dt, lead_rate + shape_acc * dt)
            lead += lead_rate * dt
        else:
            lead += wish * dt
        e = clip(lead - psi, -lead_max, lead_max)
        lead = psi + e
        demand = clip(sqrt_control(e, ang, stop_acc) + lead_rate, -rate_max, rate_max)
        target += f_t * (demand - target)
        last = error
        error += f_e * (target - measured - error)
        slope += f_d * ((error - last) / dt - slope)
        if not limited or integral * error < 0.0:
            integral = clip(integral + ki * error * dt, -imax, imax)
        u = kp * error + integral + kd * slope
        thrust = clip(u, -1.0, 1.0)
        limited = thrust != u
        sent[j] = thrust
        if k >= 0:
            output[k] = thrust
        applied = actuate(delayed(sent, j, late, trim), actuator, memory)
        psi, r = advance(psi, r, applied + (push if k >= push_at else 0.0), plant)


class SubYaw(VelocityLoop):
    """``Axis.law == "sub-yaw"``."""

    name = "sub-yaw"
    tuned: Sequence[str] = (P, I, ANG)
    integral = I
    fixed: Settings = FIXED
    usual_step = math.radians(30.0)
    free_overshoot = REPAID
    defaults: Settings = DEFAULTS
    both_ways = True
    hold = 8.0
    kernel = staticmethod(compiled(_fly))
    gains = _Gains
    vector: Sequence[str] = (P, I, D, ANG)
    filters: Sequence[str] = FILTERS
    gyro = "INS_GYRO_FILTER"
    _heading = SubHeading()

    def _shaping(self, settings: Settings) -> float:
        most = math.radians(self._get(settings, "ATC_ACCEL_Y_MAX") / 100.0)
        return most if most > 0.0 else 1e6

    def velocity_limit(self, settings: Settings, speed: float | None) -> float:
        """Return ATC_ACCEL_Y_MAX [rad/s^2]."""
        return self._shaping(settings)

    def starts(
        self, model: SingleDof, wanted: ReferenceModel, settings: Settings, speed: float | None
    ) -> list[dict[str, float]]:
        """Damping ``2/a1`` by P, the angle loop a quarter as quick, I slower still; and all half as quick."""
        drag = model.equivalent_drag(0.5 * self.usual_step)
        return [
            {
                P: max(2.0 * model.alpha * q / wanted.a1 - drag, 1e-3),
                I: 0.05 * model.alpha * (q / wanted.a1) ** 2,
                ANG: 0.5 * q / wanted.a1,
            }
            for q in (2.0, 1.0)
        ]

    def limits(self, settings: Settings, speed: float | None, dt: float) -> _Limits:
        """Return IMAX, turn rate, shaping acceleration, whether it acts, deceleration, most lead of the target."""
        shape, angle = self._shaping(settings), settings[ANG]
        rate_max = math.radians(self._get(settings, "ATC_RATE_Y_MAX"))
        return _Limits(
            imax=self._get(settings, "ATC_RAT_YAW_IMAX"),
            rate_max=rate_max if rate_max > 0.0 else 1e6,
            shape_acc=shape,
            shaped=self._get(settings, "ATC_RATE_FF_ENAB"),
            stop_acc=min(max(0.5 * shape, ACCELERATION[0]), ACCELERATION[1]),
            lead_max=min(ACCELERATION[1] / angle, ERROR_MAX) if angle > 0.0 else ERROR_MAX,
        )

    def controller(self, settings: Settings, speed: float | None) -> Rational:
        """Return measured turn rate to output, the angle loop closed through its integral."""
        return self._heading.controller(settings, speed)

    def integral_rate(self, settings: Settings, speed: float | None) -> float:
        """Return that of the heading law: the angle loop is in place."""
        return self._heading.integral_rate(settings, speed)

    def notes(self, model: SingleDof, settings: Settings, speed: float | None) -> list[str]:
        """Say why the angle gain is among them."""
        return [
            f"ArduSub's yaw stick moves a heading target, so {ANG} is in the loop and is chosen with the rate gains, "
            "here for how turn rates are followed; `tune heading` chooses the same gains for how headings are held"
        ]
