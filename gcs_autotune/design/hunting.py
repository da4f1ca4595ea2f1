"""Residual limit cycle or offset of a loop with dead zone and backlash, from a long simulation.

A describing function would predict it from the first harmonic alone (Miskovic2010, chapter 6, uses the inverse). The
simulation includes every limit of the autopilot.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.design.laws import Scenario, Settings
from gcs_autotune.design.matching import DesignProblem
from gcs_autotune.design.result import Hunting

__all__ = ["hunting_of"]

Array = NDArray[np.float64]

LONG = 300.0
"""Duration of the simulation after the step [s].

Project choice. The last half is evaluated, because the step response has decayed by then.
"""

REST = 1e-3
"""Amplitude, relative to the step, below which the craft counts as at rest. Project choice."""


def hunting_of(problem: DesignProblem, settings: Settings, step: float) -> Hunting:
    """Return the residual motion long after a step of *step* [rad or m], simulated with *settings* on the identified
    model.

    The simulation has no noise.
    """
    motion = problem.law.simulate(
        problem.model, settings, Scenario(step, LONG), problem.spec.speed, problem.delay, problem.actuator
    )
    last = len(motion.t) // 2
    t, error = motion.t[last:], motion.position[last:] - step
    amplitude = 0.5 * float(np.ptp(error))
    offset = float(0.5 * (error.max() + error.min()))
    travel = float(np.abs(np.diff(motion.output[last:])).sum() / (t[-1] - t[0]))
    if amplitude <= REST * abs(step):
        return Hunting(0.0, math.inf, offset, travel)
    return Hunting(amplitude, _period(t, error - offset), offset, travel)


def _period(t: Array, deviation: Array) -> float:
    """Return the mean time between upward zero crossings; infinite if there are fewer than two."""
    up = t[1:][(deviation[:-1] < 0.0) & (deviation[1:] >= 0.0)]
    return float((up[-1] - up[0]) / (len(up) - 1)) if len(up) > 1 else math.inf
