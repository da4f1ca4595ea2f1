"""What a loop on a velocity asks of a craft that moves: the shared half of the speed and turn-rate laws.

A step goes from ``base`` to ``base + step``; a negative one starts above and comes down to ``base``, as the step back
on the water does. What is told as position is the velocity, less that at its start.
"""

from __future__ import annotations

from abc import abstractmethod

import numpy as np

from gcs_autotune.design.actuator import PERFECT, Actuator
from gcs_autotune.design.laws.flown_law import FlownLaw
from gcs_autotune.design.laws.kernel import plant_vector
from gcs_autotune.design.laws.law import Motion, Scenario, Settings
from gcs_autotune.design.model_function import wanted_step
from gcs_autotune.design.open_loop import Rational
from gcs_autotune.design.result import ModelFunction
from gcs_autotune.models import SingleDof

__all__ = ["AboutSpeed", "holding", "local_drag", "start_of"]

LEAST_ROOM = 0.05
"""Share of full output that counts as left over at the end of the step, though there be none."""


def holding(model: SingleDof, velocity: float) -> float:
    """Return the force [fraction of full thrust] that keeps *velocity* [m/s or rad/s]."""
    return (model.beta + model.beta_quadratic * abs(velocity)) * velocity - model.delta


def local_drag(model: SingleDof, velocity: float) -> float:
    """Return the slope of the drag at *velocity*: what damps small motions there."""
    return model.beta + 2.0 * model.beta_quadratic * abs(velocity)


def start_of(step: float, base: float) -> float:
    """Return the velocity a step starts from."""
    return base if step >= 0.0 else base - step


class AboutSpeed(FlownLaw):
    """The velocity is controlled, about the one the craft keeps.

    Attributes
    ----------
    both_ways : whether steps go from half of them one way to half the other way, not up from the craft's speed.
    hold : a loop that has long settled is shown from so much [s] of holding its velocity.
    """

    controls_velocity = True
    both_ways = False
    hold: float

    def base(self, step: float, speed: float | None) -> float:
        """Return the velocity that steps of size *step* start from and come back to."""
        return -0.5 * abs(step) if self.both_ways else speed or 0.0

    def demand(
        self, model: SingleDof, wanted: ModelFunction, step: float, settings: Settings, speed: float | None
    ) -> tuple[float, float]:
        """Return (what accelerates, as a share of the output left over at the end; largest acceleration)."""
        base = self.base(step, speed)
        ideal = wanted_step(wanted, np.linspace(0.0, 12.0 / wanted.omega_0, 400))
        acceleration = step * ideal.velocity
        room = max(1.0 - abs(holding(model, base + step)), LEAST_ROOM)
        most = float(np.max(np.abs(acceleration)))
        velocity = base + step * ideal.position
        drag = (model.beta + model.beta_quadratic * np.abs(velocity)) * velocity - model.delta
        beyond = np.maximum(np.abs(model.alpha * acceleration + drag) - abs(holding(model, base + step)), 0.0)
        return float(np.max(beyond)) / room, most

    def drags(self, model: SingleDof, wanted: ModelFunction, step: float, speed: float | None) -> tuple[float, ...]:
        """Return the slopes of the drag at both ends of the step."""
        if model.beta_quadratic == 0.0:
            return (model.beta,)
        base = self.base(step, speed)
        return tuple(sorted({local_drag(model, base), local_drag(model, base + step)}))

    def holding_output(self, model: SingleDof, actuator: Actuator, settings: Settings, velocity: float) -> float:
        """Return the controller's output [fraction] that keeps *velocity*, at most full."""
        return min(max(holding(model, velocity), -1.0), 1.0)

    def simulate(
        self,
        model: SingleDof,
        settings: Settings,
        scenario: Scenario,
        speed: float | None,
        delay: float,
        actuator: Actuator = PERFECT,
    ) -> Motion:
        """Fly *scenario*."""
        dt = self.loop_period(settings)
        velocity = start_of(scenario.step, self.base(scenario.step, speed))
        before = round(self.hold / dt) if scenario.lead == 0.0 else 0
        start = np.array([velocity, self.holding_output(model, actuator, settings, velocity), before])
        craft = plant_vector(model, scenario, dt, delay)
        return self.fly(settings, speed, scenario.duration, craft, actuator.vector(dt), start)

    def position_path(self, settings: Settings, speed: float | None) -> Rational:
        """Return measured velocity to output: here the same as :meth:`controller`."""
        return self.controller(settings, speed)

    @abstractmethod
    def controller(self, settings: Settings, speed: float | None) -> Rational:
        """Return measured velocity to output."""
