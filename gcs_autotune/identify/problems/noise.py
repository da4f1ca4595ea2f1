"""Noise models: white Gaussian noise, and Gaussian noise rounded by a coarse sensor.

A sensor that rounds to multiples of ``q`` reports ``y`` if true value plus noise falls into the cell about ``y``::

    P(y | x) = Phi((y + q/2 - x)/sigma) - Phi((y - q/2 - x)/sigma)

The sources are Heitjan1989 (grouped data) and Wang2003 (system identification). A limit cycle repeats, and so do its
rounding errors. They are neither white nor of zero mean, and treating them as noise of variance ``q**2/12`` biases the
fit. A sensor that truncates instead of rounding shifts every cell by half a step. The free initial position absorbs
this shift.

An outlier would have zero probability. A fraction :data:`STRAY` of the samples may therefore have any value between the
extremes of the signal. The probability is then ``(1 - STRAY) P + STRAY q/(span + q)``.
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
"""Fraction of a rounding sensor's samples that may have any value.

Project choice: the information decreases by 0.1 %.
"""

FINEST = 0.05
"""Smallest noise accepted, in steps of the sensor. Project choice.

If no sample is near the edge of a cell, the noise estimate would go to zero, and so would the standard errors. Stamps
are not that accurate.
"""

TAIL = 6.0
"""Number of standard deviations beyond which cells are ignored in the expected information. Project choice."""

SMALLEST = 1e-250
"""Probability of a cell below which it is ignored, because its ratios would be 0/0. Project choice."""


class Terms(NamedTuple):
    """Values per sample for a descent, each (n,).

    - ``deviance``: ``-2 log p``.
    - ``slope``: derivative of ``log p`` by the true value.
    - ``curvature``: approximate minus second derivative of ``log p``, 0 or more.
    """

    deviance: Array
    slope: Array
    curvature: Array


class NoiseModel(Protocol):
    """Interface of the distribution of the measurement error of one kind of signal."""

    @property
    def sigma(self) -> float:
        """Standard deviation of the noise before rounding."""

    @property
    def quantum(self) -> float:
        """Step of the sensor, 0 if rounding is negligible."""

    @property
    def robust(self) -> bool:
        """Whether outliers have a lower weight in the fit and in the noise level."""

    @property
    def std(self) -> float:
        """Standard deviation of measured minus true value, including rounding."""

    def terms(self, error: Array) -> Terms:
        """Return deviance, slope and curvature at *error* (n,), which is measured minus simulated."""

    def information(self, error: Array) -> Array:
        """Return the expected information (n, 3) per sample.

        The columns are the information on the true value, the mixed term of true value and log sigma, and the
        information on log sigma.
        """

    def log_likelihood(self, error: Array) -> float:
        """Return the logarithm of the density of *error* or, with rounding, of its probability."""

    def likeliest(self, error: Array, level: float) -> NoiseModel:
        """Return the noise model with the highest likelihood for *error*.

        level : standard deviation of *error*, with a lower limit.
        """


@dataclass(frozen=True, slots=True)
class Gaussian:
    """White Gaussian noise of standard deviation ``sigma``.

    ``robust``: whether to use the weights of the soft-L1 loss.
    """

    sigma: float
    robust: bool = False

    @property
    def quantum(self) -> float:
        """Step of the sensor, 0 because there is no rounding."""
        return 0.0

    @property
    def std(self) -> float:
        """Standard deviation of the noise."""
        return self.sigma

    def terms(self, error: Array) -> Terms:
        """Return deviance, slope and curvature at *error* (n,). The constant of the density is left out."""
        weight = np.full(len(error), self.sigma**-2)
        if self.robust:
            weight /= np.sqrt(1.0 + (error / (2.0 * self.sigma)) ** 2)
        return Terms(weight * error**2, weight * error, weight)

    def information(self, error: Array) -> Array:
        """Return the expected information (n, 3); see :class:`NoiseModel`."""
        return np.tile([self.sigma**-2, 0.0, 2.0], (len(error), 1))

    def log_likelihood(self, error: Array) -> float:
        """Return the logarithm of the density of *error*. Robust weights do not apply."""
        constant = math.log(self.sigma) + 0.5 * math.log(2.0 * math.pi)
        return -len(error) * constant - 0.5 * float(error @ error) / self.sigma**2

    def likeliest(self, error: Array, level: float) -> Gaussian:
        """Return Gaussian noise of standard deviation *level*."""
        return replace(self, sigma=level)


@dataclass(frozen=True, slots=True)
class Rounded:
    """Gaussian noise of standard deviation ``sigma``, rounded to ``quantum``.

    ``span``: range between the extremes of the signal.
    """

    sigma: float
    quantum: float
    span: float

    @property
    def robust(self) -> bool:
        """Whether outliers have a lower weight: False, because they have a probability of their own."""
        return False

    @property
    def std(self) -> float:
        """Standard deviation of measured minus true value, ``sqrt(sigma**2 + quantum**2/12)`` (Sheppard)."""
        return math.hypot(self.sigma, self.quantum / math.sqrt(12.0))

    @property
    def stray(self) -> float:
        """Probability of one cell for a sample that may have any value."""
        return STRAY * self.quantum / (self.span + self.quantum)

    def terms(self, error: Array) -> Terms:
        """Return deviance, slope and curvature at *error*.

        The curvature is that of the cell's own probability, times its fraction of the total probability. This product
        is the weight in an EM step. The curvature is therefore never negative, even for outliers.
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
        """Return the expected information (n, 3), summed over the cells within reach of the true value."""
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
        """Return the logarithm of the probability of *error*."""
        return -0.5 * float(self.terms(error).deviance.sum())

    def likeliest(self, error: Array, level: float) -> Rounded:
        """Return the noise model with the highest likelihood for *error*.

        ``sigma`` is at least :data:`FINEST` steps, and at most twice the larger of *level* and the step.
        """

        def with_noise(log_sigma: float) -> Rounded:
            return replace(self, sigma=math.exp(log_sigma))

        optimum = minimize_scalar(
            lambda z: -with_noise(z).log_likelihood(error),
            bounds=(math.log(FINEST * self.quantum), math.log(2.0 * max(self.quantum, level))),
            method="bounded",
            options={"xatol": 1e-3},
        )
        return with_noise(float(optimum.x))

    def _cell(self, error: Array) -> tuple[Array, Array, Array]:
        """Return the edges of the cell in standard deviations, and its probability, accurate in both tails."""
        low = (error - 0.5 * self.quantum) / self.sigma
        high = (error + 0.5 * self.quantum) / self.sigma
        above = low > 0.0
        cell = ndtr(np.where(above, -low, high)) - ndtr(np.where(above, -high, low))
        return low, high, cell


def gaussian_noise(levels: Mapping[str, float], *, robust: bool = False) -> dict[str, NoiseModel]:
    """Return a Gaussian noise model for each name in *levels*."""
    return {name: Gaussian(level, robust) for name, level in levels.items()}


def _density(z: Array) -> Array:
    density: Array = np.exp(-0.5 * z * z) / math.sqrt(2.0 * math.pi)
    return density
