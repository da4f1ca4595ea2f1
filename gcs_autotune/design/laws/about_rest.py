"""What a loop on a position asks of a craft that rests: the shared half of the heading and depth laws."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from gcs_autotune.design.actuator import PERFECT, Actuator
from gcs_autotune.design.laws.flown_law import FlownLaw
from gcs_autotune.design.laws.kernel import plant_vector
from gcs_autotune.design.laws.law import Motion, Scenario, Settings
from gcs_autotune.design.model_function import wanted_step
from gcs_autotune.design.result import ModelFunction
from gcs_autotune.models import SingleDof

__all__ = ["AboutRest", "linearisations", "peak_demand"]


def peak_demand(model: SingleDof, wanted: ModelFunction, step: float) -> tuple[float, float]:
    """Return (largest output [fraction], largest velocity) of following *wanted* exactly over *step*.

    The plant's inverse along the model function's own step; nothing of the controller comes in.
    """
    ideal = wanted_step(wanted, np.linspace(0.0, 12.0 / wanted.omega_0, 400))
    velocity, acceleration = step * ideal.velocity, step * ideal.acceleration
    drag = (model.beta + model.beta_quadratic * np.abs(velocity)) * velocity
    ahead = model.alpha * acceleration + drag
    return float(np.max(np.abs(ahead)) + abs(model.delta)), float(np.max(np.abs(velocity)))


@lru_cache(maxsize=1024)
def linearisations(model: SingleDof, wanted: ModelFunction, step: float) -> tuple[float, ...]:
    """Return the constant drags to judge stability with: at rest, and at half the wanted step's peak velocity."""
    moving = model.equivalent_drag(0.5 * peak_demand(model, wanted, step)[1])
    return (model.beta,) if model.beta_quadratic == 0.0 else (model.beta, moving)


class AboutRest(FlownLaw):
    """The position is controlled, the craft comes to rest at the end of every step."""

    controls_velocity = False

    def demand(
        self, model: SingleDof, wanted: ModelFunction, step: float, settings: Settings, speed: float | None
    ) -> tuple[float, float]:
        """Return :func:`peak_demand`."""
        return peak_demand(model, wanted, step)

    def drags(self, model: SingleDof, wanted: ModelFunction, step: float, speed: float | None) -> tuple[float, ...]:
        """Return :func:`linearisations`."""
        return linearisations(model, wanted, step)

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
        craft = plant_vector(model, scenario, dt, delay, actuator)
        return self.fly(settings, speed, scenario.duration, craft, actuator.vector(dt))
