"""ArduSub's turn-rate loop of the yaw stick in STABILIZE and ALT_HOLD.

Every mode of ArduSub includes the angle loop. The stick moves a heading target at the commanded rate, shaped by
ATC_ACCEL_Y_MAX. This rate is fed forward, and ATC_ANG_YAW_P corrects the heading lag. That gain is therefore tuned
together with the rate PID, for the turn rate (decision 10). ``N = P e + I int(e) + D de/dt``. The turn rate takes the
place of the position.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from gcs_autotune.control import ReferenceModel
from gcs_autotune.design.laws.kernel import Cascade
from gcs_autotune.design.laws.law import Settings
from gcs_autotune.design.laws.loops import VelocityLoop
from gcs_autotune.design.laws.sub_heading import ACCELERATION, ANG, ERROR_MAX, FIXED, I, P, SubHeading
from gcs_autotune.design.laws.sub_heading import DEFAULTS as OF_HEADING
from gcs_autotune.design.open_loop import Rational
from gcs_autotune.models import SingleDof

__all__ = ["SubYaw"]

REPAID = 0.1
"""Overshoot, relative to the step, that the control structure causes.

The craft lags the moving target at first and must then turn faster to catch up. No rate gains can avoid this.
"""
UNUSED = ("ATC_SLEW_YAW", "ATC_INPUT_TC")
"""Parameters that shape headings but not turn rates."""
DEFAULTS: Settings = {n: v for n, v in OF_HEADING.items() if n not in UNUSED}


class SubYaw(VelocityLoop):
    """Control law ``Axis.law == "sub-yaw"``."""

    name = "sub-yaw"
    tuned: Sequence[str] = (P, I, ANG)
    integral = I
    fixed: Settings = FIXED
    usual_step = math.radians(30.0)
    free_overshoot = REPAID
    defaults: Settings = DEFAULTS
    both_ways = True
    hold = 8.0
    gyro = "INS_GYRO_FILTER"
    _heading = SubHeading()

    def velocity_limit(self, settings: Settings, speed: float | None) -> float:
        """Return the acceleration limit ATC_ACCEL_Y_MAX [rad/s^2]."""
        return self._heading.shaping(settings)

    def starts(
        self, model: SingleDof, wanted: ReferenceModel, settings: Settings, speed: float | None
    ) -> list[dict[str, float]]:
        """Return a P with damping ``2/a1``, an angle loop at a quarter of that speed, and a slower I.

        In the second start all are half as fast.
        """
        drag = model.equivalent_drag(0.5 * self.usual_step)
        return [
            {
                P: max(2.0 * model.alpha * q / wanted.a1 - drag, 1e-3),
                I: 0.05 * model.alpha * (q / wanted.a1) ** 2,
                ANG: 0.5 * q / wanted.a1,
            }
            for q in (2.0, 1.0)
        ]

    def cascade(self, settings: Settings, speed: float | None, dt: float) -> Cascade:
        """Return the stages of the heading's angle loop, whose target the stick moves."""
        loop, angle = self._heading.angle_loop(settings), settings[ANG]
        return loop._replace(lead_max=min(ACCELERATION[1] / angle, ERROR_MAX) if angle > 0.0 else ERROR_MAX)

    def controller(self, settings: Settings, speed: float | None) -> Rational:
        """Return the transfer function from measured turn rate to output, with the angle loop closed through its
        integral."""
        return self._heading.controller(settings, speed)

    def integral_rate(self, settings: Settings, speed: float | None) -> float:
        """Return the rate of the heading law, because its angle loop is active."""
        return self._heading.integral_rate(settings, speed)

    def notes(self, model: SingleDof, settings: Settings, speed: float | None) -> list[str]:
        """Return a note that explains why the angle gain is included."""
        return [
            f"ArduSub's yaw stick moves a heading target, so {ANG} is part of the loop and is chosen with the rate "
            "gains. These gains are optimised for turn rates. `tune heading` optimises the same gains for headings"
        ]
