"""ArduRover's turn-rate loop alone, which is used by ACRO, GUIDED turn rates and the heading loop.

``servo = scale (FF rT + P e + I int(e) + D de/dt)``; limits, filters and scaling as in :mod:`.rover_steering`. The step
goes from half its size to port to half to starboard. The turn rate takes the place of the position.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.control import ReferenceModel
from gcs_autotune.design.laws import rover_steering as steering
from gcs_autotune.design.laws.kernel import Cascade
from gcs_autotune.design.laws.law import Settings
from gcs_autotune.design.laws.loops import VelocityLoop
from gcs_autotune.design.laws.rover_steering import FF, I, P
from gcs_autotune.design.open_loop import Rational, second_order
from gcs_autotune.models import SingleDof

__all__ = ["RoverYaw"]

DEFAULTS: Settings = {n: v for n, v in steering.DEFAULTS.items() if n != "ATC_STR_DEC_MAX"}
Array = NDArray[np.float64]


class RoverYaw(VelocityLoop):
    """Control law ``Axis.law == "rover-yaw"``."""

    name = "rover-yaw"
    tuned: Sequence[str] = (FF, P, I)
    integral = I
    fixed: Settings = steering.FIXED
    usual_step = math.radians(30.0)
    both_ways = True
    hold = 8.0
    defaults: Settings = DEFAULTS
    gyro = steering.GYRO

    def matching_speed(self, settings: Settings, speed: float | None) -> float | None:
        """Return the same speed as the heading law, at which the integral acts."""
        return steering.matching_speed(settings, speed)

    def velocity_limit(self, settings: Settings, speed: float | None) -> float:
        """Return the acceleration limit ATC_STR_ACC_MAX [rad/s^2]."""
        most = math.radians(self._get(settings, "ATC_STR_ACC_MAX"))
        return most if most > 0.0 else math.inf

    def cascade(self, settings: Settings, speed: float | None, dt: float) -> Cascade:
        """Return the steering controller alone."""
        return steering.cascade(settings, speed)

    def starts(
        self, model: SingleDof, wanted: ReferenceModel, settings: Settings, speed: float | None
    ) -> list[dict[str, float]]:
        """Return a feed-forward that cancels the drag, and a PI with damping ``2/a1``, stiffness ``1/a1^2``.

        The second start is half as fast.
        """
        scale = steering.scale(settings, speed)
        drag = model.equivalent_drag(0.5 * self.usual_step) / scale
        alpha = model.alpha / scale
        return [
            {FF: drag, P: max(2.0 * alpha * q / wanted.a1 - drag, 0.0), I: alpha * (q / wanted.a1) ** 2}
            for q in (2.0, 1.0)
        ]

    def controller(self, settings: Settings, speed: float | None) -> Rational:
        """Return the transfer function from measured turn rate to servo; the feed-forward is outside the loop."""
        return steering.steering_pid(settings, speed) * second_order(self._get(settings, self.gyro))

    def integral_rate(self, settings: Settings, speed: float | None) -> float:
        """Return ``I / (P + FF)``, where the feed-forward represents the craft's own drag; infinite if the integral is
        frozen."""
        if not steering.integral_grows(settings, speed):
            return math.inf
        return settings[I] / max(settings[P] + settings[FF], 1e-12)

    def notes(self, model: SingleDof, settings: Settings, speed: float | None) -> list[str]:
        """Return notes on the speeds at which the gains are valid, and on dependent loops."""
        return [
            *steering.speed_notes(model, settings, speed),
            "ATC_STR_ANG_P is unchanged. `tune heading` chooses it together with these gains",
        ]
