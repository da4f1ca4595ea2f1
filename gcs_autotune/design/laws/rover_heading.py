"""ArduRover's heading loop: angle P over a turn-rate FF/P/I/D, with limits, filters and speed scaling.

``servo = scale * (FF rT + P e + I int(e) + D de/dt)``, with ``rT`` from ``ATC_STR_ANG_P * (psi_d - psi)``. ``scale`` is
``MOT_SPD_SCA_BASE/V`` at speeds above MOT_SPD_SCA_BASE and 1 below. At or below that speed the integral cannot grow
(:mod:`.rover_steering`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from gcs_autotune.control import ReferenceModel
from gcs_autotune.design.laws import rover_steering as steering
from gcs_autotune.design.laws.kernel import Cascade
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
from gcs_autotune.models import SingleDof

__all__ = ["RoverHeading", "alike"]

ANG = "ATC_STR_ANG_P"
LOW_FEED = 0.7
"""Feed-forward, relative to that of the model, below which the proposal has a note. Project choice."""
BARELY = 1.1
"""Largest ATC_STR_ANG_P for which the note names its documented minimum of 1 as the reason. Project choice."""


class RoverHeading(PositionLoop):
    """Control law ``rover-heading`` (``Axis.law``): ArduRover's heading loop."""

    name = "rover-heading"
    tuned: Sequence[str] = (FF, P, I, ANG)
    integral = I
    fixed: Settings = steering.FIXED
    late: Sequence[str] = (D,)
    usual_step = math.radians(30.0)
    defaults: Settings = steering.DEFAULTS
    gyro = steering.GYRO

    def matching_speed(self, settings: Settings, speed: float | None) -> float | None:
        """Return *speed*, or a speed just above MOT_SPD_SCA_BASE.

        There the scale is the same as below, but the integral acts.
        """
        return steering.matching_speed(settings, speed)

    def velocity_limit(self, settings: Settings, speed: float | None) -> float:
        """Return the smaller of the limits by ATC_STR_RAT_MAX and ATC_TURN_MAX_G at *speed* [rad/s]."""
        return steering.turn_limit(settings, speed)

    def cascade(self, settings: Settings, speed: float | None, dt: float) -> Cascade:
        """Return the stages: angle P with limits of acceleration and turn rate, followed by the steering controller."""
        acceleration = math.radians(self._get(settings, "ATC_STR_ACC_MAX"))
        stop = math.radians(self._get(settings, "ATC_STR_DEC_MAX"))
        return steering.cascade(settings, speed)._replace(
            on_position=1.0,
            angle=1.0,
            position_p=settings.get(ANG, 0.0),
            stop_acceleration=stop if stop > 0.0 else acceleration,
        )

    def starts(
        self, model: SingleDof, wanted: ReferenceModel, settings: Settings, speed: float | None
    ) -> list[dict[str, float]]:
        """Return gains that match the coefficients of the closed loop to *wanted*, for ``G = K/(T s + 1)`` and ``FF =
        1/K``.

        The coefficients are ``a3 = T/(K I A)``, ``a2 = (1 + K P)/(K I A)``, ``a1 = 1/A + (FF + P)/I``. The quadratic
        equation in A does not have a real root for every specification; its real part is then used. The second set of
        gains omits the integral: ``a1 = 1/A``, ``a2 = T/(A (1 + K P))``.
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
        """Return the transfer function from heading error to turn-rate demand."""
        return first_order(self._get(settings, "ATC_STR_RAT_FLTT")) * constant(settings[ANG])

    def controller(self, settings: Settings, speed: float | None) -> Rational:
        """Return the transfer function from measured turn rate to servo."""
        feed, pid = constant(settings[FF] * steering.scale(settings, speed)), steering.steering_pid(settings, speed)
        turn = self._angle(settings) * integrator()
        return feed * turn + pid * (turn + second_order(self._get(settings, self.gyro)))

    def position_path(self, settings: Settings, speed: float | None) -> Rational:
        """Return the transfer function from measured heading to servo."""
        feed = constant(settings[FF] * steering.scale(settings, speed))
        return (feed + steering.steering_pid(settings, speed)) * self._angle(settings)

    def integral_rate(self, settings: Settings, speed: float | None) -> float:
        """Return the rate [1/s] ``A I / (A (FF + P) + I)``, or infinity if the integral is frozen."""
        if not steering.integral_grows(settings, speed):
            return math.inf
        return integral_over_proportional(settings[ANG], settings[FF] + settings[P], settings[I])

    def notes(self, model: SingleDof, settings: Settings, speed: float | None) -> list[str]:
        """Return notes on the speeds at which the gains are valid, and on turn rates."""
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
        why = (
            f", but the heading loop would then need {ANG} below its documented minimum of 1"
            if bound
            else ". The proposed gains are those for the heading step, within their ranges"
        )
        limit = self._get(settings, "ATC_STR_RAT_MAX")
        return [
            f"{FF} = {ideal:.3g} would follow turn rates best{why}. At this speed the craft turns at most "
            f"{most:.0f} deg/s. ATC_STR_RAT_MAX limits the required rate to {limit:g} deg/s"
        ]


def alike(settings: Settings, feed: float) -> dict[str, float]:
    """Return *settings* with the feed-forward *feed* and with gains that follow headings nearly as well as before.

    ``(FF + P) ANG`` and the rate at which a constant force is compensated stay the same.
    """
    more = (feed + settings[P]) / max(settings[FF] + settings[P], 1e-9)
    return {**settings, FF: feed, I: settings[I] * more, ANG: settings[ANG] / more}
