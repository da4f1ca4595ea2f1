"""Interface of a control law of an autopilot."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.control import ReferenceModel
from gcs_autotune.design.actuator import PERFECT, Actuator
from gcs_autotune.design.open_loop import Rational
from gcs_autotune.models import SingleDof

__all__ = ["SKID", "THROTTLE", "Law", "LoopMotion", "LoopStart", "Scenario", "Settings", "setting"]

Settings = Mapping[str, float]
"""Parameter name -> value: the autopilot's present limits and filters, with the gains being evaluated."""


SKID = "skid"
"""Name of a setting of a law: 1 if the craft steers by the difference of two thrusters (``Spec.skid``)."""
THROTTLE = "throttle"
"""Name of a setting of a law: the throttle [fraction] at which a boat was identified (``Spec.throttle``)."""


@dataclass(frozen=True, slots=True)
class LoopStart:
    """State of a velocity loop at the start of a flown step. Its integral follows from both values.

    - ``ahead`` [m/s or rad/s]: velocity, relative to the target before the step.
    - ``output``: output to the actuator [fraction of full].
    """

    ahead: float
    output: float


@dataclass(frozen=True, slots=True)
class Scenario:
    """A step of size *step* [rad or m], and a constant force *push* [fraction of full] from the time ``push_at`` [s].

    Without ``lead``, the step is at t = 0, and the loop already compensates the craft's own constant force. With
    ``lead``, the loop starts on a craft at rest, with an integral of zero, and the step starts ``lead`` [s] later. At
    ``back_at`` [s] the step is reversed. The integral is not reset. A velocity loop begins the step at ``start``, if
    that is given, instead of at rest.
    """

    step: float
    duration: float
    push: float = 0.0
    push_at: float = math.inf
    lead: float = 0.0
    back_at: float = math.inf
    start: LoopStart | None = None


@dataclass(frozen=True, slots=True, eq=False)
class LoopMotion:
    """Motion of a simulated loop: arrays (n,) at the autopilot's loop rate, in SI units. The output is normalised."""

    t: NDArray[np.float64]
    position: NDArray[np.float64]
    output: NDArray[np.float64]


class Law(Protocol):
    """Interface of a control law: one control structure of one firmware, with the firmware's own parameter names."""

    name: str
    tuned: Sequence[str]
    """Names of the gains that matching may change. The other gains of the law keep their ``fixed`` values."""
    integral: str
    """Name of the gain among ``tuned`` that sets the integral action."""
    fixed: Settings
    late: Sequence[str]
    """Names of gains among ``fixed`` that the last stage of an automatic design may also change."""
    defaults: Settings
    """Name -> firmware default of the law's parameters, for parameters that the vehicle did not report."""
    usual_step: float
    controls_velocity: bool
    """Whether the step is in velocity (surge velocity or turn rate) and not in position."""
    free_overshoot: float
    """Overshoot that the control structure itself causes, relative to the step. It is not attributed to the gains."""
    measured: Sequence[str]
    """Names of the gains that are set to measured values (``Spec.measured``)."""

    def loop_period(self, settings: Settings) -> float:
        """Return the autopilot's loop period [s]."""
        ...

    def matching_speed(self, settings: Settings, speed: float | None) -> float | None:
        """Return the speed [m/s] at which gains are matched, so that all terms of the law act.

        It is *speed*, unless the law freezes a term at that speed.
        """
        ...

    def velocity_limit(self, settings: Settings, speed: float | None) -> float:
        """Return the largest velocity that the autopilot commands [rad/s or m/s]."""
        ...

    def demand(
        self, model: SingleDof, wanted: ReferenceModel, step: float, settings: Settings, speed: float | None
    ) -> tuple[float, float]:
        """Return the actuator use [fraction] and the largest velocity or acceleration, for following *wanted*
        exactly.
        """
        ...

    def drags(self, model: SingleDof, wanted: ReferenceModel, step: float, speed: float | None) -> tuple[float, ...]:
        """Return the values of linear drag for which stability is checked."""
        ...

    def slopes(
        self, actuator: Actuator, model: SingleDof, step: float, settings: Settings, speed: float | None
    ) -> tuple[float, ...]:
        """Return the gains from the controller's output to force for small motions."""
        ...

    def starts(
        self, model: SingleDof, wanted: ReferenceModel, settings: Settings, speed: float | None
    ) -> list[dict[str, float]]:
        """Return sets of gains that follow from *wanted* by algebra, without limits.

        The first set is the most accurate.
        """
        ...

    def simulate(
        self,
        model: SingleDof,
        settings: Settings,
        scenario: Scenario,
        speed: float | None,
        delay: float,
        actuator: Actuator = PERFECT,
    ) -> LoopMotion:
        """Return the motion of the loop in *scenario*, simulated on *model* with all nonlinearities.

        delay : delay [s] in addition to that of *model*.
        """
        ...

    def controller(self, settings: Settings, speed: float | None) -> Rational:
        """Return the transfer function from measured velocity to actuator output, without the sign.

        The feedback of position is included as the integral of the velocity.
        """
        ...

    def position_path(self, settings: Settings, speed: float | None) -> Rational:
        """Return the transfer function from measured position to actuator output, without the sign.

        It determines the effect of noise.
        """
        ...

    def integral_rate(self, settings: Settings, speed: float | None) -> float:
        """Return the rate [1/s] at which the integral compensates a constant force.

        It is the ratio of integral to proportional gain of the position, or infinite if the autopilot permits no
        integral action.
        """
        ...

    def notes(self, model: SingleDof, settings: Settings, speed: float | None) -> list[str]:
        """Return sentences on the validity of the gains in *settings*, and on their limits."""
        ...


def setting(settings: Settings, defaults: Settings, name: str) -> float:
    """Return the value of the parameter *name*, or the firmware's default if the vehicle reported no value (or NaN)."""
    value = settings.get(name, math.nan)
    return float(value) if math.isfinite(value) else float(defaults[name])
