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

__all__ = ["SKID", "THROTTLE", "Law", "LoopMotion", "Scenario", "Settings", "setting"]

Settings = Mapping[str, float]
"""Parameter name -> value: the autopilot's present limits and filters, with the gains being evaluated."""


SKID = "skid"
"""Name of a setting of a law: 1 if the craft steers by the difference of two thrusters (``Spec.skid``)."""
THROTTLE = "throttle"
"""Name of a setting of a law: the throttle [fraction] at which a boat was identified (``Spec.throttle``)."""


@dataclass(frozen=True, slots=True)
class Scenario:
    """A step of *step* [rad or m], and a constant force *push* [fraction] from ``push_at`` [s] on.

    Without ``lead``, the step is at t = 0, and the loop already compensates the craft's own constant force. With
    ``lead``, the loop starts on a craft at rest, with an empty integral, and the step comes ``lead`` [s] later. At
    ``back_at`` [s] the step is reversed, with the integral as it is then.
    """

    step: float
    duration: float
    push: float = 0.0
    push_at: float = math.inf
    lead: float = 0.0
    back_at: float = math.inf


@dataclass(frozen=True, slots=True, eq=False)
class LoopMotion:
    """Motion of a simulated loop: arrays (n,) at the autopilot's loop rate, SI units, output in fractions."""

    t: NDArray[np.float64]
    position: NDArray[np.float64]
    output: NDArray[np.float64]


class Law(Protocol):
    """One control structure of one firmware, with the firmware's own parameter names."""

    name: str
    tuned: Sequence[str]
    """Gains that matching may change; the law's other gains keep their ``fixed`` values."""
    integral: str
    """The gain among ``tuned`` that sets the integral action."""
    fixed: Settings
    late: Sequence[str]
    """Gains among ``fixed`` that the last stage of an automatic design may also change, if that helps."""
    defaults: Settings
    """Firmware defaults of the law's parameters, for parameters that the vehicle did not report."""
    usual_step: float
    controls_velocity: bool
    """Whether the step is in velocity (of surge, or the turn rate) and not in position."""
    free_overshoot: float
    """Overshoot that the structure itself causes, relative to the step; it is not attributed to the gains."""
    measured: Sequence[str]
    """Gains that are set to measured values (``Spec.measured``)."""

    def loop_period(self, settings: Settings) -> float:
        """Return the autopilot's loop period [s]."""
        ...

    def matching_speed(self, settings: Settings, speed: float | None) -> float | None:
        """Return the speed [m/s] at which gains are matched, so that all terms act.

        It is the craft's speed, unless the law freezes a term at that speed.
        """
        ...

    def velocity_limit(self, settings: Settings, speed: float | None) -> float:
        """Return the largest velocity that the autopilot commands [rad/s or m/s]."""
        ...

    def demand(
        self, model: SingleDof, wanted: ReferenceModel, step: float, settings: Settings, speed: float | None
    ) -> tuple[float, float]:
        """Return (actuator use, largest velocity or acceleration) for following *wanted* exactly."""
        ...

    def drags(self, model: SingleDof, wanted: ReferenceModel, step: float, speed: float | None) -> tuple[float, ...]:
        """Return the constant drags for which stability is checked."""
        ...

    def slopes(
        self, actuator: Actuator, model: SingleDof, step: float, settings: Settings, speed: float | None
    ) -> tuple[float, ...]:
        """Return the gains from the controller's output to force for small motions."""
        ...

    def starts(
        self, model: SingleDof, wanted: ReferenceModel, settings: Settings, speed: float | None
    ) -> list[dict[str, float]]:
        """Return unbounded algebraic gains for *wanted*; the first set is the most accurate."""
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
        """Simulate *scenario* on *model* with all nonlinearities.

        delay : delay [s] in addition to the model's.
        """
        ...

    def controller(self, settings: Settings, speed: float | None) -> Rational:
        """Return the transfer function from measured velocity to actuator output, without the sign.

        It includes the position, as the integral of the velocity.
        """
        ...

    def position_path(self, settings: Settings, speed: float | None) -> Rational:
        """Return the transfer function from measured position to actuator output, without the sign; noise takes this
        path."""
        ...

    def integral_rate(self, settings: Settings, speed: float | None) -> float:
        """Return the rate [1/s] at which the integral compensates a constant force.

        It is the ratio of integral to proportional gain of the position. It is infinite if the autopilot permits no
        integral action.
        """
        ...

    def notes(self, model: SingleDof, settings: Settings, speed: float | None) -> list[str]:
        """Return sentences on the validity of the gains in *settings*, and on their limits."""
        ...


def setting(settings: Settings, defaults: Settings, name: str) -> float:
    """Return a parameter's value; if the vehicle reported none (or NaN), return the firmware's default."""
    value = settings.get(name, math.nan)
    return float(value) if math.isfinite(value) else float(defaults[name])
