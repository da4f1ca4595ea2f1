"""The result of a fit with process noise, and how its innovations move with its unknowns."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.effects import EffectInstance
from gcs_autotune.identify.free_numbers import ModelFit
from gcs_autotune.identify.kalman.noisy_objective import log_density
from gcs_autotune.identify.kalman.process_noise import ProcessNoise

__all__ = ["NoisyFit", "Tangent"]

Array = NDArray[np.float64]

HALF_WIDTH = 1.96
"""Standard errors to either end of a 95 % interval."""

WIDEST = 10.0
"""Half the 95 % interval of a logarithm from which on nothing is known."""


@dataclass(frozen=True, slots=True, eq=False)
class NoisyFit(ModelFit):
    """A fit with process noise: ``theta`` (p,) are the form's free parameters only.

    ``noise`` as fitted; ``log_likelihood``: (records,) of each record. ``covariance`` (q, q) of the base's parameters,
    then the effects', then the logarithms of the noise's unknowns. ``innovations``: per record stamps, innovation and
    its variance.
    """

    noise: ProcessNoise
    log_likelihood: Array
    covariance: Array
    innovations: tuple[tuple[Array, Array, Array], ...]

    @property
    def total(self) -> float:
        """The log-likelihood of all records."""
        return float(self.log_likelihood.sum())

    def densities(self, rougher: float = 1.0) -> Array:
        """Return the log density (samples,) of every innovation, record after record, their variances *rougher*."""
        return np.concatenate([log_density(e, rougher * S, self.noise.freedom) for _, e, S in self.innovations])

    @property
    def roughness(self) -> float:
        """The mean of the squares of all innovations over what their variances say."""
        return float(np.mean(np.concatenate([e * e / S for _, e, S in self.innovations])))

    @property
    def unknowns(self) -> int:
        """How many numbers were fitted."""
        return len(self.theta) + len(self.free_effects) + len(self.noise.unknowns)

    @property
    def samples(self) -> int:
        """How many samples were predicted."""
        return sum(len(e) for _, e, _ in self.innovations)

    def price(self, more: int) -> float:
        """Return what so many numbers more cost (Schwarz), as log-likelihood."""
        return 0.5 * more * math.log(max(self.samples, 2))

    def errors_of(self, effect: EffectInstance) -> dict[str, float]:
        """Return the standard errors of those of an effect's numbers that were fitted, where they are known."""
        return {n: std for n, std in self.errors_in(self.covariance, effect).items() if not math.isnan(std)}

    def interval_of(self, name: str) -> tuple[float, float]:
        """Return the 95 % interval of one of the noise's unknowns, from the standard error of its logarithm.

        From 0 to inf where it was not fitted, or where nothing limits it.
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
    """Derivatives of all innovations (samples,) and of their log variances by the unknowns of a fit, (q, samples)."""

    J: Array
    D: Array
