"""What a step will look like, in the form results carry."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.design.laws import Scenario, Settings
from gcs_autotune.design.matching import Problem
from gcs_autotune.design.model_function import wanted_step
from gcs_autotune.design.result import ModelFunction, Prediction, StepMetrics
from gcs_autotune.design.step_metrics import combine, step_metrics
from gcs_autotune.models import SingleDof

__all__ = ["predict", "predict_metrics"]

Array = NDArray[np.float64]

LEAD = 3.0
"""The craft is held this long [s] before the flown step: as long as the step experiment waits for steadiness."""
RATE = 50.0
"""Most samples per second kept [Hz]."""


def predict(
    problem: Problem, model: SingleDof, wanted: ModelFunction, settings: Settings, duration: float
) -> Prediction:
    """Simulate the step and the step back on *model* with *settings* for *duration* [s] each.

    The arrays are those of the step; the metrics are those of both, joined as the flown ones are.
    """
    there, back = (_fly(problem, model, settings, s) for s in _there_and_back(problem, problem.step, duration))
    t, position, output = there
    metrics = combine([_measure(problem, problem.step, there), _measure(problem, -problem.step, back)])
    ideal = problem.step * wanted_step(wanted, t).position
    return Prediction(t, np.full_like(t, problem.step), position, ideal, output, metrics)


def predict_metrics(problem: Problem, settings: Settings, step: float, duration: float) -> StepMetrics:
    """Return what :func:`predict` would measure for a step of *step* [rad or m] on the identified model."""
    pair = _there_and_back(problem, step, duration)
    return combine([_measure(problem, s.step, _fly(problem, problem.model, settings, s)) for s in pair])


def _there_and_back(problem: Problem, step: float, duration: float) -> tuple[Scenario, Scenario]:
    """Return both steps: as flown where the flight is known, else of a loop that has long settled."""
    lead = LEAD if problem.spec.step_duration is not None else 0.0
    return Scenario(step, duration + lead, lead=lead), Scenario(-step, duration)


def _fly(problem: Problem, model: SingleDof, settings: Settings, scenario: Scenario) -> tuple[Array, Array, Array]:
    """Return t (n,) from the step on, position and output, at the rate that is kept."""
    motion = problem.law.simulate(model, settings, scenario, problem.spec.speed, problem.delay, problem.actuator)
    period = problem.law.loop_period(settings)
    every = max(round(1.0 / (RATE * period)), 1)
    kept = slice(round(scenario.lead / period), None, every)
    return motion.t[kept] - scenario.lead, motion.position[kept], motion.output[kept]


def _measure(problem: Problem, step: float, flown: tuple[Array, Array, Array]) -> StepMetrics:
    """Measure a step as the flown one is: the target was the position at rest, and errors within the noise are none."""
    t, position, output = flown
    spec = problem.spec
    target = np.full_like(t, step)
    target[0] = 0.0
    return step_metrics(t, target, position, output, noise_std=spec.noise_std, quantum=spec.quantum)
