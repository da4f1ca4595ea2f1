"""Reference models of the closed loop, ``1/(a3 s^3 + a2 s^2 + a1 s + 1)``.

The form is Miskovic2010, eq. (8.4), with time scaled such that ``a3 = 1/omega_0^3`` ("characteristic frequency"). The
Bessel polynomial is ``s^3/15 + 6 s^2/15 + s + 1``; Miskovic2010 prints ``2 s^2/15``, an erratum.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

from gcs_autotune.design.result import ReferenceModel
from gcs_autotune.errors import UsageError
from gcs_autotune.registry import lookup

__all__ = [
    "REFERENCE_MODELS",
    "SETTLED",
    "ReferenceStep",
    "omega_for_settling",
    "reference_model",
    "settling_time",
    "wanted_step",
]

REFERENCE_MODELS: Mapping[str, tuple[float, float, float]] = {
    "bessel": (1.0, 6.0 / 15.0, 1.0 / 15.0),
    "butterworth": (2.0, 2.0, 1.0),
}
"""Family -> (a1, a2, a3) at its textbook time scale.

A Bessel step has an overshoot of 0.75 %, a Butterworth step of 8 %.
"""

SETTLED = 0.05
"""Deviation, relative to the step, within which a step counts as settled (5 %, as in ``StepMetrics``)."""

_UNIT_HORIZON = 20.0
_UNIT_STEP = 0.01


@dataclass(frozen=True, slots=True, eq=False)
class ReferenceStep:
    """Unit step of a reference model: position [1], velocity [1/s] and acceleration [1/s^2], each (n,)."""

    position: NDArray[np.float64]
    velocity: NDArray[np.float64]
    acceleration: NDArray[np.float64]


def reference_model(kind: str, omega_0: float) -> ReferenceModel:
    """Return the reference model of family *kind* with characteristic frequency *omega_0* [rad/s].

    Raises
    ------
    UnknownName
        *kind* is not in :data:`REFERENCE_MODELS`.
    UsageError
        *omega_0* is not a positive number.
    """
    a1, a2, a3 = lookup(REFERENCE_MODELS, kind, "reference model")
    if not (np.isfinite(omega_0) and omega_0 > 0.0):
        raise UsageError(f"the characteristic frequency must be a positive number of rad/s, not {omega_0}")
    stretch = a3 ** (-1.0 / 3.0) / omega_0
    return ReferenceModel(kind, omega_0, a1 * stretch, a2 * stretch**2, a3 * stretch**3)


def settling_time(kind: str, omega_0: float) -> float:
    """Return the time [s] at which the reference model's step has settled to 5 %."""
    return _unit_settling(kind) / omega_0


def omega_for_settling(kind: str, seconds: float) -> float:
    """Return the characteristic frequency [rad/s] for which the step of the family *kind* settles to 5 % in *seconds*.

    Raises
    ------
    UsageError
        *seconds* is not a positive number.
    """
    lookup(REFERENCE_MODELS, kind, "reference model")
    if not (np.isfinite(seconds) and seconds > 0.0):
        raise UsageError(f"the settling time must be a positive number of seconds, not {seconds}")
    return _unit_settling(kind) / seconds


def wanted_step(function: ReferenceModel, t: NDArray[np.float64]) -> ReferenceStep:
    """Return the unit step response of *function* at the times *t* (n,) [s]. It is zero before ``t = 0``."""
    grid, states = _unit_response(function.kind)
    scaled = t * function.omega_0
    columns = [np.interp(scaled, grid, states[:, i], left=0.0) for i in range(3)]
    return ReferenceStep(columns[0], columns[1] * function.omega_0, columns[2] * function.omega_0**2)


@cache
def _unit_response(kind: str) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the unit step of the family at omega_0 = 1: times (n,) and states (n, 3), exact at the grid points."""
    f = reference_model(kind, 1.0)
    generator = np.zeros((4, 4))
    generator[0, 1] = generator[1, 2] = 1.0
    generator[2] = np.array([-1.0, -f.a1, -f.a2, 1.0]) / f.a3
    transition = expm(generator * _UNIT_STEP)
    count = int(_UNIT_HORIZON / _UNIT_STEP) + 1
    states = np.zeros((count, 4))
    states[0, 3] = 1.0
    for i in range(1, count):
        states[i] = transition @ states[i - 1]
    return _UNIT_STEP * np.arange(count, dtype=np.float64), states[:, :3]


@cache
def _unit_settling(kind: str) -> float:
    grid, states = _unit_response(kind)
    outside = np.flatnonzero(np.abs(states[:, 0] - 1.0) > SETTLED)
    return float(grid[outside[-1] + 1])
