"""What a fit by least squares leaves: the model, what is left over, and its Jacobian."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.effects import ExtendedModel
from gcs_autotune.identify.free_numbers import ModelFit
from gcs_autotune.identify.least_squares import inverse_of
from gcs_autotune.identify.likelihood import Residual
from gcs_autotune.models import CoupledModel

__all__ = ["Fitted"]

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Fitted(ModelFit):
    """A fitted model.

    ``initial`` (n,) per segment; ``cost`` minus twice the log-likelihood (up to a constant of the data), ``levels``
    noise per signal, ``rests`` what is left over, ``samples`` how many were used; ``jacobian`` (n, q) over the noise
    levels, row for row the finite ``judged`` of ``rests``; ``converged``. ``shift`` [s]: by which input stamps dated
    midway turned out too early, the last column of ``jacobian`` when there are such; known beforehand to be
    0 +- ``shift_std`` (0 when they are exact). ``learnt``: noise per signal when disturbances last learnt from what was
    left over; empty where there are none.
    """

    initial: tuple[Array, ...]
    cost: float
    levels: Mapping[str, float]
    rests: tuple[Residual, ...]
    jacobian: Array
    samples: int
    converged: bool
    shift: float = 0.0
    shift_std: float = 0.0
    learnt: Mapping[str, float] = field(default_factory=dict)

    @property
    def base(self) -> CoupledModel:
        """The model without its effects."""
        return CoupledModel(self.form, dict(zip(self.form.parameters, self.theta.tolist(), strict=True)))

    @property
    def model(self) -> ExtendedModel:
        """The model."""
        return ExtendedModel(self.base, self.effects)

    def value(self, name: str) -> float:
        """Return a base parameter's value."""
        return float(self.theta[self.form.parameters.index(name)])

    @property
    def shared(self) -> Array:
        """The fitted numbers (f,): base parameters, then those of the effects."""
        places = [self.form.parameters.index(n) for n in self.free]
        return np.concatenate([self.theta[places], [self.effects[i].values[n] for i, n in self.free_effects]])

    @property
    def parameters(self) -> int:
        """How many numbers were fitted besides initial states."""
        return len(self.free) + len(self.free_effects)

    @property
    def residual(self) -> Array:
        """All finite judged residuals over their noise levels (n,), in the order of ``jacobian``."""
        return np.concatenate([r.judged[np.isfinite(r.judged)] / self.levels[r.signal] for r in self.rests])

    def covariance(self, raised: float = 1.0) -> Array:
        """Return the covariance of the fitted numbers, times *raised* for coloured residuals."""
        return raised * inverse_of(self.information(raised))

    def information(self, raised: float = 1.0) -> Array:
        """Return the information matrix (q, q), that of what is known of the shift beforehand taken times *raised*."""
        information = np.asarray(self.jacobian.T @ self.jacobian)
        if self.shift_std:
            information[-1, -1] += raised / self.shift_std**2
        return information
