"""What a fit with effects leaves: the model, its uncertainty, and every residual."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.effects import EffectInstance, ExtendedModel
from gcs_autotune.identify.least_squares import inverse_of
from gcs_autotune.models.coupled import CoupledModel, Form

__all__ = ["Fitted", "Rest"]

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Rest:
    """What is left of one signal of one segment: stamps, measured, predicted (n,), and the residual as judged;
    ``penalty`` what a judging disturbance adds to minus twice the log-likelihood, ``fold`` which part was left out.
    """

    segment: int
    signal: str
    t: Array
    measured: Array
    predicted: Array
    judged: Array
    penalty: float = 0.0
    fold: int = 0


@dataclass(frozen=True, slots=True, eq=False)
class Fitted:
    """A fitted model.

    ``theta`` (p,), ``effects``, ``initial`` (n,) per segment; ``cost`` minus twice the log-likelihood (up to a
    constant of the data), ``levels`` noise per signal, ``rests`` what is left over, ``parameters`` how many numbers
    were fitted besides initial states, ``samples`` how many were used; ``jacobian`` (n, q) over the noise levels, row
    for row the finite ``judged`` of ``rests``; ``converged``. ``shift`` [s]: by which input stamps dated midway turned
    out too early, the last column of ``jacobian`` when there are such; known beforehand to be 0 +- ``slack``.
    """

    form: Form
    theta: Array
    effects: tuple[EffectInstance, ...]
    initial: tuple[Array, ...]
    cost: float
    levels: Mapping[str, float]
    rests: tuple[Rest, ...]
    free: tuple[str, ...]
    free_effects: tuple[tuple[int, str], ...]
    jacobian: Array
    samples: int
    converged: bool
    shift: float = 0.0
    slack: float = 0.0

    @property
    def model(self) -> ExtendedModel:
        """The model."""
        values = dict(zip(self.form.parameters, self.theta.tolist(), strict=True))
        return ExtendedModel(CoupledModel(self.form, values), self.effects)

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
        if self.slack:
            information[-1, -1] += raised / self.slack**2
        return information
