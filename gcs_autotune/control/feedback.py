"""The feedback law of one motion, with any structure of table 8.1, and the controller that runs it.

Miskovic2010, section 8.1: control law (8.2), compensation of quadratic drag (8.5) with its limited speed (8.26), and
anti-windup (8.29). A law is frozen; :meth:`FeedbackLaw.started` returns a controller with the law's memory.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from gcs_autotune.control.structure import Structure
from gcs_autotune.errors import UsageError
from gcs_autotune.models import SingleDof, TransferFunction
from gcs_autotune.notebook import Displayed
from gcs_autotune.sname import wrap

__all__ = ["TRACKING_TIME", "FeedbackController", "FeedbackLaw"]

TRACKING_TIME = 1.0
"""Time in which anti-windup brings the integral back to the actuator's limit [s]: the gain of one of (8.29)."""


@dataclass(frozen=True, slots=True)
class FeedbackLaw(Displayed):
    """Gains of a controller of one motion, in units of its input per rad or m.

    Attributes
    ----------
    structure : the channels, a row of ``STRUCTURES``.
    K_P, K_I, K_D : gains of position, of its integral and of velocity.
    drag : quadratic drag coefficient that is compensated while moving, (8.5).
    drag_speed : velocity up to which it is compensated, (8.26); keeps the loop stable with an uncertain model.
    disturbance : known constant force or moment on the craft, for example its buoyancy; (8.2).
    limits : smallest and largest input.
    is_angle : the motion is an angle: errors go the short way round.
    tracking_time : of the anti-windup [s].
    """

    structure: Structure
    K_P: float
    K_I: float = 0.0
    K_D: float = 0.0
    drag: float = 0.0
    drag_speed: float = math.inf
    disturbance: float = 0.0
    limits: tuple[float, float] = (-math.inf, math.inf)
    is_angle: bool = False
    tracking_time: float = TRACKING_TIME

    def __post_init__(self) -> None:
        """Reject limits in the wrong order and gains that are not numbers."""
        low, high = self.limits
        if not low < high:
            raise UsageError(f"the limits of a controller must rise, not {low:g} to {high:g}")
        if not all(math.isfinite(gain) for gain in (self.K_P, self.K_I, self.K_D, self.drag, self.disturbance)):
            raise UsageError(f"the gains of {self.structure.name} must be finite: {self}")

    def with_limits(self, low: float, high: float) -> FeedbackLaw:
        """Return it for an actuator of that range."""
        return replace(self, limits=(low, high))

    def started(self, command: float = 0.0) -> FeedbackController:
        """Return a controller whose first command is *command*, so that it takes over without a jump.

        A structure without an integral has no memory: its first command is what its gains give.
        """
        return FeedbackController(self, command)

    def closed_loop(self, model: SingleDof) -> TransferFunction:
        """Return set-point to position on *model*; quadratic drag counts as compensated, the delay is left out."""
        return self.structure.closed_loop(model, self.K_P, self.K_I, self.K_D)


class FeedbackController:
    """A law that runs: one call of :meth:`update` per control tick."""

    def __init__(self, law: FeedbackLaw, command: float = 0.0) -> None:
        self.law = law
        self._first = command
        self._integral = math.nan
        self._value = self._origin = self._reference = self._t = math.nan

    @property
    def integral(self) -> float:
        """Output of the integral channel; NaN before the first update."""
        return self._integral

    def update(self, reference: float, value: float, rate: float, t: float) -> float:
        """Return the command at time *t* [s].

        Parameters
        ----------
        reference, value : set-point and measurement [rad or m]; an angle may wrap.
        rate : velocity [rad/s or m/s].
        """
        law, structure = self.law, self.law.structure
        is_first = math.isnan(self._t)
        dt = 0.0 if is_first else max(t - self._t, 0.0)
        if is_first:
            self._value = self._origin = value
            self._reference = reference
        self._value += self._difference(value, self._value)
        error = self._difference(reference, value)
        # the derivative of the error is that of the set-point less the velocity, which is measured
        slope = self._difference(reference, self._reference) / dt if dt > 0.0 else 0.0
        self._reference, self._t = reference, t

        proportional = law.K_P * (error if structure.proportional == "error" else self._origin - self._value)
        derivative = 0.0
        if structure.derivative is not None:
            derivative = law.K_D * ((slope if structure.derivative == "error" else 0.0) - rate)
        compensated = law.drag * min(abs(rate), law.drag_speed) * rate - law.disturbance
        without_integral = proportional + derivative + compensated
        if is_first:
            self._integral = self._first - without_integral if structure.integral else 0.0
        demand = without_integral + self._integral
        command = min(max(demand, law.limits[0]), law.limits[1])
        if structure.integral:
            excess = (demand - command) * min(dt / law.tracking_time, 1.0)
            self._integral += law.K_I * error * dt - excess
        return command

    def _difference(self, a: float, b: float) -> float:
        return wrap(a - b) if self.law.is_angle else a - b
