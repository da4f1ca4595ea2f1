"""Measured minus simulated, for every signal of every stretch, and what can be read off the signals beforehand."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.identify.segment import Segment, Signal
from gcs_autotune.models.simulation import simulate_explicit

__all__ = ["Residual", "first_levels", "first_states", "quanta_of", "residuals_of", "roughness", "rounding_error"]

Array = NDArray[np.float64]

SAME_GRID = 0.02
"""Largest deviation, in steps, of one stretch's grid from another's."""


@dataclass(frozen=True, slots=True, eq=False)
class Residual:
    """One signal of one stretch: measured minus simulated, and the Jacobian of the simulation (n, 7)."""

    record: int
    signal: Signal
    error: Array
    jacobian: Array


def residuals_of(
    records: Sequence[Segment], names: Sequence[str], theta: Array, initial: Array
) -> list[Residual] | None:
    """Simulate every record and compare the signals called *names*; None when a simulation runs away."""
    found = []
    for i, record in enumerate(records):
        signals = [s for s in record.signals.values() if s.name in names]
        stamps = signals[0].t if len(signals) == 1 else np.union1d(signals[0].t, signals[1].t)
        motion = simulate_explicit(np.concatenate([theta, initial[i]]), record.t_in, record.tau, stamps)
        if not motion.finite:
            return None
        for signal in signals:
            at = np.searchsorted(stamps, signal.t)
            is_position = signal.name == record.dof.position
            value, slope = (motion.eta, motion.eta_by) if is_position else (motion.nu, motion.nu_by)
            found.append(Residual(i, signal, signal.values - value[at], slope[at]))
    return found


def first_states(records: Sequence[Segment], names: Sequence[str]) -> Array:
    """Return initial states read off the first samples."""
    states = np.zeros((len(records), 2))
    for i, record in enumerate(records):
        for signal in record.signals.values():
            if signal.name == record.dof.position:
                states[i, 0] = signal.values[0]
                states[i, 1] = np.polyfit(signal.t[:5] - signal.t[0], signal.values[:5], 1)[0]
        if record.velocity is not None and record.velocity.name in names:
            states[i, 1] = record.velocity.values[0]
    return states


def first_levels(records: Sequence[Segment], names: Sequence[str]) -> dict[str, float]:
    """Return noise levels to begin with: the scatter about a parabola through five neighbours."""
    levels = {}
    for name in names:
        rough = [roughness(s) for r in records for s in r.signals.values() if s.name == name]
        if rough:
            levels[name] = max(float(np.mean(rough)), 1e-9)
    return levels


def quanta_of(records: Sequence[Segment], names: Sequence[str]) -> dict[str, float]:
    """Return the steps of those signals whose rounding is too coarse to pass for Gaussian noise.

    Coarse means a step above the signal's own roughness, ``sqrt(sigma**2 + q**2/12)``, that is ``q > 1.04 sigma``;
    below it mean and variance of the rounding error are those of independent noise to 1e-7, whatever the truth
    (Widrow2008, the quantisation theorems). All stretches must share one grid.
    """
    quanta = {}
    for name, level in first_levels(records, names).items():
        steps = np.array([s.step for r in records for s in r.signals.values() if s.name == name])
        finest = float(steps.min())
        if finest > level and np.all(np.abs(steps / finest - np.round(steps / finest)) < SAME_GRID):
            quanta[name] = finest
    return quanta


def rounding_error(residuals: Sequence[Residual], name: str) -> float:
    """Return the rounding error of the coarsest sensor called *name*: ``step/sqrt(12)``."""
    return max((r.signal.step for r in residuals if r.signal.name == name), default=0.0) / math.sqrt(12.0)


def roughness(signal: Signal) -> float:
    """Return the scatter of *signal* about a parabola through its neighbours."""
    third = np.diff(signal.values, n=3)
    return max(
        float(np.sqrt(np.mean(third**2) / 20.0)),
        signal.step / math.sqrt(12.0),
        1e-6 * float(np.ptp(signal.values)),
    )
