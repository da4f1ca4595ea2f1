"""Does the loop come to rest? What dead zone and play leave behind, read off a long simulation.

A describing function would foretell it from the first harmonic alone (Miskovic2010, chapter 6 uses it the other way
round);
here every limit of the autopilot is in the loop, so the simulation is asked.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.design.laws import Scenario, Settings
from gcs_autotune.design.matching import DesignProblem

__all__ = ["Hunting", "hunting_of"]

Array = NDArray[np.float64]

LONG = 300.0
"""How long the loop is left alone [s]; what is told is of the last half."""

REST = 1e-3
"""Share of the step below which nothing is said to move."""


@dataclass(frozen=True, slots=True)
class Hunting:
    """A loop left alone after a step: ``amplitude`` and ``offset`` [rad or m] of what goes on, its ``period`` [s].

    ``period`` is infinite when the position does not swing; ``travel`` what the output moves [fraction of full per s].
    """

    amplitude: float
    period: float
    offset: float
    travel: float

    @property
    def swings(self) -> bool:
        """Whether there is a limit cycle."""
        return math.isfinite(self.period)


def hunting_of(problem: DesignProblem, settings: Settings, step: float) -> Hunting:
    """Return what is left of a step of *step* [rad or m] after a long time on the identified model, without noise."""
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


def _period(t: Array, swing: Array) -> float:
    """Return the mean time between upward crossings of zero; infinite with fewer than two of them."""
    up = t[1:][(swing[:-1] < 0.0) & (swing[1:] >= 0.0)]
    return float((up[-1] - up[0]) / (len(up) - 1)) if len(up) > 1 else math.inf
