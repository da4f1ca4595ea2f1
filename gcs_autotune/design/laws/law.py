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
"""Parameter name -> value: the autopilot's limits and filters in force, and the gains being tried."""


SKID = "skid"
"""Among the settings of a law, 1 when the craft steers by the difference of two thrusters (``Spec.skid``)."""
THROTTLE = "throttle"
"""Among the settings of a law, the throttle [fraction] that a boat was identified at (``Spec.throttle``)."""


@dataclass(frozen=True, slots=True)
class Scenario:
    """A step of *step* [rad or m], and a constant force *push* [fraction] from ``push_at`` [s] on.

    Without ``lead`` the step comes at t = 0 to a loop that has long worked off the craft's own constant force. With
    it the loop takes over a craft at rest, its integral empty, and the step comes ``lead`` [s] later. At ``back_at``
    [s] the step is taken back: with whatever its integral holds by then.
    """

    step: float
    duration: float
    push: float = 0.0
    push_at: float = math.inf
    lead: float = 0.0
    back_at: float = math.inf


@dataclass(frozen=True, slots=True, eq=False)
class LoopMotion:
    """What a simulated loop did: arrays (n,) at the autopilot's loop rate, SI units, output in fractions."""

    t: NDArray[np.float64]
    position: NDArray[np.float64]
    output: NDArray[np.float64]


class Law(Protocol):
    """One control structure of one firmware, under the firmware's own parameter names."""

    name: str
    tuned: Sequence[str]
    """The gains that matching may choose; the law's other gains keep ``fixed`` values."""
    integral: str
    """The one among ``tuned`` that makes the integral action."""
    fixed: Settings
    late: Sequence[str]
    """Gains among ``fixed`` that the last stage of an automatic design may also change if that helps."""
    defaults: Settings
    """Firmware defaults of the law's parameters, for those the vehicle did not report."""
    usual_step: float
    controls_velocity: bool
    """Whether what is stepped is the velocity (of surge, or the turn rate) and not the position."""
    free_overshoot: float
    """Overshoot of the structure itself, relative to the step; it does not count against the gains."""
    measured: Sequence[str]
    """Gains that are set to what was measured (``Spec.measured``)."""

    def loop_period(self, settings: Settings) -> float:
        """Return the autopilot's loop period [s]."""
        ...

    def matching_speed(self, settings: Settings, speed: float | None) -> float | None:
        """Return the speed [m/s] to match gains at, where all terms act: the craft's unless it freezes one."""
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
        """Return the constant drags to judge stability with."""
        ...

    def slopes(
        self, actuator: Actuator, model: SingleDof, step: float, settings: Settings, speed: float | None
    ) -> tuple[float, ...]:
        """Return the gains from the controller's output to force around which small motions live."""
        ...

    def starts(
        self, model: SingleDof, wanted: ReferenceModel, settings: Settings, speed: float | None
    ) -> list[dict[str, float]]:
        """Return unbounded algebraic gains for *wanted*; the first is the closest to exact."""
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
        """Fly *scenario* on *model* with everything nonlinear in place; *delay* [s] is beyond the model's."""
        ...

    def controller(self, settings: Settings, speed: float | None) -> Rational:
        """Return measured velocity (position included, as its integral) to actuator output, sign aside."""
        ...

    def position_path(self, settings: Settings, speed: float | None) -> Rational:
        """Return the transfer from measured position to actuator output (sign aside): what noise goes through."""
        ...

    def integral_rate(self, settings: Settings, speed: float | None) -> float:
        """Return the rate [1/s] at which the integral compensates a constant force: integral over proportional gain of
        the position.

        Infinite where the autopilot allows no integral action at all.
        """
        ...

    def notes(self, model: SingleDof, settings: Settings, speed: float | None) -> list[str]:
        """Return sentences on the validity of the gains in *settings*, and what limits them."""
        ...


def setting(settings: Settings, defaults: Settings, name: str) -> float:
    """Return a parameter's value, or the firmware's default if the vehicle reported none (or NaN)."""
    value = settings.get(name, math.nan)
    return float(value) if math.isfinite(value) else float(defaults[name])
