"""What a step will look like, in the form results carry."""

from __future__ import annotations

import numpy as np

from gcs_autotune.design.laws import Scenario, Settings
from gcs_autotune.design.matching import Problem
from gcs_autotune.design.model_function import wanted_step
from gcs_autotune.design.result import ModelFunction, Prediction
from gcs_autotune.design.step_metrics import step_metrics
from gcs_autotune.models import SingleDof

__all__ = ["predict"]

RATE = 50.0
"""Most samples per second kept [Hz]."""


def predict(
    problem: Problem, model: SingleDof, wanted: ModelFunction, settings: Settings, duration: float
) -> Prediction:
    """Simulate the wanted step on *model* with *settings* for *duration* [s]."""
    scenario = Scenario(problem.step, duration)
    motion = problem.law.simulate(model, settings, scenario, problem.spec.speed, problem.delay)
    every = max(round(1.0 / (RATE * problem.law.loop_period(settings))), 1)
    t, position, output = motion.t[::every], motion.position[::every], motion.output[::every]
    target = np.full_like(t, problem.step)
    ideal = problem.step * wanted_step(wanted, t).position
    return Prediction(t, target, position, ideal, output, step_metrics(t, target, position, output))
