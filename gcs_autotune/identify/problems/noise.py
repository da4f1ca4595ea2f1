"""How likely a measurement is: white Gaussian noise, or Gaussian noise rounded by a coarse sensor.

A sensor that rounds to multiples of ``q`` reports ``y`` when truth plus noise falls into the cell about ``y``::

    P(y | x) = Phi((y + q/2 - x)/sigma) - Phi((y - q/2 - x)/sigma)

(grouped data: Heitjan1989; in system
identification: Wang2003). A limit cycle repeats, so do its rounding
errors: they are neither white nor of mean zero, and calling them noise of variance ``q**2/12`` biases the fit. A
sensor that truncates instead of rounding shifts every cell by half a step, which the free initial position takes up.

An outlier would have no probability at all, so a share :data:`STRAY` of the samples may be anything between the
extremes of the signal: ``(1 - STRAY) P + STRAY q/(span + q)``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar
from scipy.special import ndtr

__all__ = ["FINEST", "STRAY", "Gaussian", "NoiseModel", "Rounded", "Terms", "gaussian_noise"]

Array = NDArray[np.float64]

STRAY = 1e-3
"""Fraction of a rounding sensor's samples that may have any value; it costs 0.1 % of the information."""

FINEST = 0.05
"""Smallest noise accepted, in steps of the sensor.

If no sample falls near the edge of a cell, the noise estimate would go to zero and the accuracy to infinity. Stamps are
not that accurate.
"""

TAIL = 6.0
"""Standard deviations beyond which cells are not visited in the expected information."""

SMALLEST = 1e-250
"""Probability below which a cell is taken as out of reach (its ratios would be 0/0)."""


class Terms(NamedTuple):
    """Per sample: ``-2 log p``, the derivative of ``log p`` by the truth, and a curvature >= 0 (each (n,))."""

    deviance: Array
    slope: Array
    curvature: Array


class NoiseModel(Protocol):
    """The distribution of one kind of signal's measurement error."""

    @property
    def sigma(self) -> float:
        """Standard deviation of the noise before any rounding."""

    @property
    def quantum(self) -> float:
        """Step of the sensor, 0 when it does not matter."""

    @property
    def robust(self) -> bool:
        """Whether outliers weigh less, in the fit and in the noise level."""

    @property
    def std(self) -> float:
        """Standard deviation of measured minus true, rounding included."""

    def terms(self, error: Array) -> Terms:
        """Return what a descent needs at *error* = measured minus simulated."""

    def information(self, error: Array) -> Array:
        """Return the (n, 3) expected information: of the truth, of truth with log sigma, of log sigma."""

    def log_likelihood(self, error: Array) -> float:
        """Return the logarithm of the density (or, with rounding, the probability) of *error*."""

    def likeliest(self, error: Array, level: float) -> NoiseModel:
        """Return the law that makes *error* likeliest; *level* is its standard deviation, not too small."""


@dataclass(frozen=True, slots=True)
class Gaussian:
    """White noise of standard deviation ``sigma``; ``robust`` gives it the weights of the soft-L1 loss."""

    sigma: float
    robust: bool = False

    @property
    def quantum(self) -> float:
        """No rounding."""
        return 0.0

    @property
    def std(self) -> float:
        """As ``sigma``."""
        return self.sigma

    def terms(self, error: Array) -> Terms:
        """As :class:`NoiseModel`; the constant of the density is left out."""
        weight = np.full(len(error), self.sigma**-2)
        if self.robust:
            weight /= np.sqrt(1.0 + (error / (2.0 * self.sigma)) ** 2)
        return Terms(weight * error**2, weight * error, weight)

    def information(self, error: Array) -> Array:
        """As :class:`NoiseModel`."""
        return np.tile([self.sigma**-2, 0.0, 2.0], (len(error), 1))

    def log_likelihood(self, error: Array) -> float:
        """As :class:`NoiseModel`, whatever the weights."""
        constant = math.log(self.sigma) + 0.5 * math.log(2.0 * math.pi)
        return -len(error) * constant - 0.5 * float(error @ error) / self.sigma**2

    def likeliest(self, error: Array, level: float) -> Gaussian:
        """As :class:`NoiseModel`."""
        return replace(self, sigma=level)


@dataclass(frozen=True, slots=True)
class Rounded:
    """Noise of standard deviation ``sigma``, then rounding to ``quantum``; ``span`` between the extremes seen."""

    sigma: float
    quantum: float
    span: float

    @property
    def robust(self) -> bool:
        """Outliers have their share of the probability instead."""
        return False

    @property
    def std(self) -> float:
        """``sqrt(sigma**2 + quantum**2/12)`` (Sheppard)."""
        return math.hypot(self.sigma, self.quantum / math.sqrt(12.0))

    @property
    def stray(self) -> float:
        """Probability of one cell for a sample that may be anything."""
        return STRAY * self.quantum / (self.span + self.quantum)

    def terms(self, error: Array) -> Terms:
        """As :class:`NoiseModel`; the curvature is that of the cell's own probability times its share of the whole.

        That share is what an EM step would give it, so the curvature is never negative, even for outliers.
        """
        low, high, cell = self._cell(error)
        near = cell > SMALLEST
        safe = np.where(near, cell, 1.0)
        phi_low, phi_high = _density(low), _density(high)
        first = (phi_low - phi_high) / self.sigma
        second = (low * phi_low - high * phi_high) / self.sigma**2
        whole = (1.0 - STRAY) * cell + self.stray
        own = np.where(near, (1.0 - STRAY) * cell / whole, 0.0)
        slope = first / safe
        curvature = np.maximum(slope**2 - second / safe, 0.0)
        return Terms(-2.0 * np.log(whole), own * slope, own * curvature)

    def information(self, error: Array) -> Array:
        """As :class:`NoiseModel`, summed over the cells within reach of the truth."""
        reach = math.ceil(TAIL * self.sigma / self.quantum) + 1
        centre = error - self.quantum * np.round(error / self.quantum)
        edges = (centre[:, None] + self.quantum * (np.arange(-reach, reach + 2) - 0.5)) / self.sigma
        density = _density(edges)
        whole = (1.0 - STRAY) * np.diff(ndtr(edges)) + self.stray
        by_truth = -(1.0 - STRAY) * np.diff(density) / self.sigma
        by_sigma = -(1.0 - STRAY) * np.diff(edges * density)
        products = (by_truth * by_truth, by_truth * by_sigma, by_sigma * by_sigma)
        return np.column_stack([np.sum(p / whole, axis=1) for p in products])

    def log_likelihood(self, error: Array) -> float:
        """As :class:`NoiseModel`."""
        return -0.5 * float(self.terms(error).deviance.sum())

    def likeliest(self, error: Array, level: float) -> Rounded:
        """As :class:`NoiseModel`; ``sigma`` is at least :data:`FINEST` steps and at most twice *level* or the step."""

        def with_noise(log_sigma: float) -> Rounded:
            return replace(self, sigma=math.exp(log_sigma))

        found = minimize_scalar(
            lambda z: -with_noise(z).log_likelihood(error),
            bounds=(math.log(FINEST * self.quantum), math.log(2.0 * max(self.quantum, level))),
            method="bounded",
            options={"xatol": 1e-3},
        )
        return with_noise(float(found.x))

    def _cell(self, error: Array) -> tuple[Array, Array, Array]:
        """Return the cell's edges in standard deviations and its probability, exact in both tails."""
        low = (error - 0.5 * self.quantum) / self.sigma
        high = (error + 0.5 * self.quantum) / self.sigma
        above = low > 0.0
        cell = ndtr(np.where(above, -low, high)) - ndtr(np.where(above, -high, low))
        return low, high, cell


def gaussian_noise(levels: Mapping[str, float], *, robust: bool = False) -> dict[str, NoiseModel]:
    """Return a Gaussian law for each name in *levels*."""
    return {name: Gaussian(level, robust) for name, level in levels.items()}


def _density(z: Array) -> Array:
    density: Array = np.exp(-0.5 * z * z) / math.sqrt(2.0 * math.pi)
    return density
