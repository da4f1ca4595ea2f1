"""What a loop on a position asks of a craft that rests: the shared half of the heading and depth laws."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from gcs_autotune.design.actuator import Actuator
from gcs_autotune.design.laws.law import Settings
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


class AboutRest:
    """The position is controlled, the craft comes to rest at the end of every step."""

    controls_velocity = False
    free_overshoot = 0.0
    measured: Sequence[str] = ()
    late: Sequence[str] = ()

    def demand(
        self, model: SingleDof, wanted: ModelFunction, step: float, settings: Settings, speed: float | None
    ) -> tuple[float, float]:
        """Return :func:`peak_demand`."""
        return peak_demand(model, wanted, step)

    def drags(self, model: SingleDof, wanted: ModelFunction, step: float, speed: float | None) -> tuple[float, ...]:
        """Return :func:`linearisations`."""
        return linearisations(model, wanted, step)

    def slopes(
        self, actuator: Actuator, model: SingleDof, step: float, settings: Settings, speed: float | None
    ) -> tuple[float, ...]:
        """Return the actuator's gains around which small motions live."""
        return actuator.slopes()
