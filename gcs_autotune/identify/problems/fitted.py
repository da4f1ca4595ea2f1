"""Result of a least-squares fit: the model, its residuals and their Jacobian."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.effects import ExtendedModel
from gcs_autotune.identify.problems.free_numbers import ModelFit
from gcs_autotune.identify.problems.least_squares import inverse_of
from gcs_autotune.identify.problems.likelihood import Residual
from gcs_autotune.models import CoupledModel

__all__ = ["Fitted"]

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Fitted(ModelFit):
    """A model fitted by least squares.

    - ``initial``: initial states (n,) per segment.
    - ``cost``: minus twice the log-likelihood, up to a constant of the data.
    - ``levels``: name of the signal -> noise level.
    - ``rests``: residuals per signal and segment.
    - ``samples``: number of samples used.
    - ``jacobian`` (n, q): derivatives of the predictions, divided by the noise levels. Its rows are those of the finite
      ``judged`` values of ``rests``.
    - ``converged``: whether the fit converged.
    - ``shift`` [s]: time by which input stamps are too early, if they were set midway between two messages. It is the
      last column of ``jacobian`` if there is one.
    - ``shift_std`` [s]: standard deviation of the prior of ``shift`` about zero, 0 for exact stamps.
    - ``prior`` (q,): information of the priors of the fitted values, empty without any.
    - ``learnt``: noise per signal at the last update of disturbances from the residuals, empty without disturbances.
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
    prior: Array = field(default_factory=lambda: np.zeros(0))
    learnt: Mapping[str, float] = field(default_factory=dict)

    @property
    def base(self) -> CoupledModel:
        """Fitted model without its effects."""
        return CoupledModel(self.form, dict(zip(self.form.parameters, self.theta.tolist(), strict=True)))

    @property
    def model(self) -> ExtendedModel:
        """Fitted model with its effects."""
        return ExtendedModel(self.base, self.effects)

    def value(self, name: str) -> float:
        """Return the value of the base parameter *name*."""
        return float(self.theta[self.form.parameters.index(name)])

    @property
    def shared(self) -> Array:
        """Fitted values (f,) of the free base parameters, then of the free parameters of effects."""
        places = [self.form.parameters.index(n) for n in self.free]
        return np.concatenate([self.theta[places], [self.effects[i].values[n] for i, n in self.free_effects]])

    @property
    def parameters(self) -> int:
        """Number of fitted parameters of the base and of effects, without initial states."""
        return len(self.free) + len(self.free_effects)

    @property
    def residual(self) -> Array:
        """All finite ``judged`` residuals, divided by their noise levels (n,), in the order of ``jacobian``."""
        return np.concatenate([r.judged[np.isfinite(r.judged)] / self.levels[r.signal] for r in self.rests])

    def covariance(self, raised: float = 1.0) -> Array:
        """Return the covariance (q, q) of the fitted values, multiplied by *raised* for coloured residuals."""
        return raised * inverse_of(self.information(raised))

    def information(self, raised: float = 1.0) -> Array:
        """Return the information matrix (q, q) of the fitted values.

        raised : factor of the prior information.
        """
        information = np.asarray(self.jacobian.T @ self.jacobian)
        if len(self.prior):
            information[np.diag_indices(len(information))] += raised * self.prior
        return information
