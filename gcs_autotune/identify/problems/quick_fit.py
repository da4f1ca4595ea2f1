"""Estimate noise levels, sensor resolution and initial states from measured signals before any fit."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.identify.signals.segment import Segment, Signal

__all__ = ["first_levels", "first_states", "quanta_of", "roughness"]

Array = NDArray[np.float64]

SAME_GRID = 0.02
"""Largest deviation between the grids of sensor values in two segments that count as one grid [sensor steps].

Project choice.
"""


def first_levels(segments: Sequence[Segment]) -> dict[str, float]:
    """Return name of the signal -> initial noise level, which is the scatter about a parabola through neighbouring
    samples.
    """
    names = dict.fromkeys(n for s in segments for n in s.signals)
    rough = {n: [roughness(s.signals[n]) for s in segments if n in s.signals] for n in names}
    return {n: max(float(np.mean(levels)), 1e-9) for n, levels in rough.items()}


def quanta_of(segments: Sequence[Segment]) -> dict[str, float]:
    """Return name -> step for the signals whose rounding is too coarse to be treated as Gaussian noise.

    Coarse means a step above the signal's roughness ``sqrt(sigma**2 + q**2/12)``, that is, ``q > 1.04 sigma``. Below
    this, mean and variance of the rounding error equal those of independent noise to 1e-7, whatever the true value
    (Widrow2008, the quantisation theorems). All segments must share one grid of values.
    """
    quanta = {}
    for name, level in first_levels(segments).items():
        steps = np.array([s.signals[name].step for s in segments if name in s.signals])
        finest = float(steps.min())
        if finest > level and np.all(np.abs(steps / finest - np.round(steps / finest)) < SAME_GRID):
            quanta[name] = finest
    return quanta


def roughness(signal: Signal) -> float:
    """Return the scatter of *signal* about a parabola through neighbouring samples, at least the rounding error of the
    sensor.
    """
    third = np.diff(signal.values, n=3)
    return max(
        float(np.sqrt(np.mean(third**2) / 20.0)),
        signal.step / math.sqrt(12.0),
        1e-6 * float(np.ptp(signal.values)),
    )


def first_states(segments: Sequence[Segment]) -> tuple[Array, ...]:
    """Return the initial position and velocity (2,) per segment of one axis, estimated from the first samples."""
    states = []
    for segment in segments:
        own = np.zeros(2)
        position, velocity = segment.position, segment.velocity
        if position is not None:
            own[0] = position.values[0]
            own[1] = np.polyfit(position.t[:5] - position.t[0], position.values[:5], 1)[0]
        if velocity is not None:
            own[1] = velocity.values[0]
        states.append(own)
    return tuple(states)
