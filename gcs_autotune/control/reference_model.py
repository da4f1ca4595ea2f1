"""Reference models of the closed loop, ``1/(a_n s^n + ... + a_1 s + 1)``, of any order.

Miskovic2010, eq. (8.4), with time scaled such that ``a_n = 1/omega_0^n`` ("characteristic frequency"). The Bessel
polynomial of third order is ``s^3/15 + 6 s^2/15 + s + 1``; Miskovic2010 prints ``2 s^2/15``, an erratum.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

from gcs_autotune.errors import UsageError
from gcs_autotune.models import TransferFunction
from gcs_autotune.notebook import Displayed
from gcs_autotune.registry import lookup

__all__ = [
    "REFERENCE_MODELS",
    "SETTLED",
    "ReferenceModel",
    "ReferenceStep",
    "omega_for_settling",
    "reference_coefficients",
    "reference_model",
    "settling_time",
    "wanted_step",
]


def _bessel(order: int) -> tuple[float, ...]:
    """Return the reverse Bessel polynomial, divided by its constant term."""
    terms = [
        math.factorial(2 * order - k) // (2 ** (order - k) * math.factorial(k) * math.factorial(order - k))
        for k in range(order + 1)
    ]
    return tuple(term / terms[0] for term in terms[1:])


def _butterworth(order: int) -> tuple[float, ...]:
    """Return the Butterworth polynomial by its recursion in the half angle between two poles."""
    half, terms = math.pi / (2 * order), [1.0]
    for k in range(1, order + 1):
        terms.append(terms[-1] * math.cos((k - 1) * half) / math.sin(k * half))
    return tuple(round(term, 12) for term in terms[1:])


def _binomial(order: int) -> tuple[float, ...]:
    """Return ``(1 + s)^n``: all poles real and equal, no overshoot."""
    return tuple(float(math.comb(order, k)) for k in range(1, order + 1))


REFERENCE_MODELS: Mapping[str, Callable[[int], tuple[float, ...]]] = {
    "bessel": _bessel,
    "butterworth": _butterworth,
    "binomial": _binomial,
}
"""Family -> function of the order that returns (a_1, ..., a_n) at the textbook's time scale.

Overshoot of third order: Bessel 0.75 %, Butterworth 8 %, binomial none.
"""

SETTLED = 0.05
"""Deviation, relative to the step, within which a step counts as settled (5 %, as in ``StepMetrics``)."""

_UNIT_HORIZON = 20.0
_UNIT_STEP = 0.01


@dataclass(frozen=True, slots=True)
class ReferenceModel(Displayed):
    """The required closed loop ``1/(a3 s^3 + a2 s^2 + a1 s + 1)``, Miskovic2010, eq. (8.4). ``kind`` is its family."""

    kind: str
    omega_0: float
    a1: float
    a2: float
    a3: float

    def transfer_function(self) -> TransferFunction:
        """Return it as a transfer function."""
        return TransferFunction((1.0,), (1.0, self.a1, self.a2, self.a3))


@dataclass(frozen=True, slots=True, eq=False)
class ReferenceStep(Displayed):
    """Unit step of a reference model: position [1], velocity [1/s] and acceleration [1/s^2], each (n,)."""

    position: NDArray[np.float64]
    velocity: NDArray[np.float64]
    acceleration: NDArray[np.float64]


def reference_coefficients(kind: str, omega_0: float, order: int) -> tuple[float, ...]:
    """Return (a_1, ..., a_n) [s, ..., s^n] of family *kind* with characteristic frequency *omega_0* [rad/s].

    Raises
    ------
    UnknownName
        *kind* is not in :data:`REFERENCE_MODELS`.
    UsageError
        *omega_0* is not a positive number.
    """
    terms = lookup(REFERENCE_MODELS, kind, "reference model")(order)
    if not (np.isfinite(omega_0) and omega_0 > 0.0):
        raise UsageError(f"the characteristic frequency must be a positive number of rad/s, not {omega_0}")
    stretch = terms[-1] ** (-1.0 / order) / omega_0
    return tuple(term * stretch ** (k + 1) for k, term in enumerate(terms))


def reference_model(kind: str, omega_0: float) -> ReferenceModel:
    """Return the reference model of third order; see :func:`reference_coefficients`."""
    return ReferenceModel(kind, omega_0, *reference_coefficients(kind, omega_0, 3))


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
