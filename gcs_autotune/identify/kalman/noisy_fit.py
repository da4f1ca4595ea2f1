"""The result of a fit with process noise, and the derivatives of its innovations."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.effects import EffectInstance
from gcs_autotune.identify.kalman.noisy_objective import log_density
from gcs_autotune.identify.kalman.process_noise import ProcessNoise
from gcs_autotune.identify.problems.free_numbers import ModelFit
from gcs_autotune.rounding import HALF_WIDTH

__all__ = ["NoisyFit", "Tangent"]

Array = NDArray[np.float64]

WIDEST = 10.0
"""Largest half-width of the 95 % interval of a parameter's logarithm.

A parameter with a wider one counts as unknown. Project choice.
"""


@dataclass(frozen=True, slots=True, eq=False)
class NoisyFit(ModelFit):
    """Result of a fit with process noise. ``theta`` (p,): free parameters of the form only.

    - ``noise``: fitted process noise.
    - ``log_likelihood`` (records,): log-likelihood of each record.
    - ``covariance`` (q, q): covariance of the base parameters, the effects' parameters, and the logarithms of the noise
      parameters, in this order.
    - ``innovations``: stamps, innovations and variances per record.
    """

    noise: ProcessNoise
    log_likelihood: Array
    covariance: Array
    innovations: tuple[tuple[Array, Array, Array], ...]

    @property
    def gain(self) -> float:
        """Acceleration per input, the first parameter of the form."""
        return float(self.theta[0])

    @property
    def damping(self) -> float:
        """Damping per inertia [1/s], the second parameter of the form; negative if it damps."""
        return float(self.theta[1])

    @property
    def total(self) -> float:
        """Log-likelihood of all records together."""
        return float(self.log_likelihood.sum())

    def densities(self, rougher: float = 1.0) -> Array:
        """Return the log density (samples,) of every innovation, record by record.

        rougher : factor by which the variances are multiplied.
        """
        return np.concatenate([log_density(e, rougher * S, self.noise.freedom) for _, e, S in self.innovations])

    @property
    def roughness(self) -> float:
        """Mean of the squared innovations, each divided by its variance; 1 for a correct noise model."""
        return float(np.mean(np.concatenate([e * e / S for _, e, S in self.innovations])))

    @property
    def unknowns(self) -> int:
        """Number of fitted parameters, including those of effects and of the noise."""
        return len(self.theta) + len(self.free_effects) + len(self.noise.unknowns)

    @property
    def samples(self) -> int:
        """Number of predicted samples in all records."""
        return sum(len(e) for _, e, _ in self.innovations)

    def price(self, more: int) -> float:
        """Return the penalty for *more* further parameters (Schwarz criterion), in units of log-likelihood."""
        return 0.5 * more * math.log(max(self.samples, 2))

    def errors_of(self, effect: EffectInstance) -> dict[str, float]:
        """Return name -> standard error of the fitted parameters of *effect*, without those of unknown error."""
        return {n: std for n, std in self.errors_in(self.covariance, effect).items() if not math.isnan(std)}

    def interval_of(self, name: str) -> tuple[float, float]:
        """Return the 95 % interval of the noise parameter *name*, from the standard error of its logarithm.

        The interval is 0 to inf if the parameter was not fitted, or if the data do not limit it.
        """
        names = self.noise.unknowns
        if name not in names:
            return 0.0, math.inf
        k = len(self.covariance) - len(names) + names.index(name)
        wide = HALF_WIDTH * math.sqrt(max(float(self.covariance[k, k]), 0.0))
        if not wide < WIDEST:
            return 0.0, math.inf
        value: float = getattr(self.noise, name)
        return value * math.exp(-wide), value * math.exp(wide)


@dataclass(frozen=True, slots=True, eq=False)
class Tangent:
    """Derivatives by the unknowns of a fit.

    - ``J`` (q, samples): derivatives of all innovations.
    - ``D`` (q, samples): derivatives of the logarithms of the innovations' variances.
    """

    J: Array
    D: Array
