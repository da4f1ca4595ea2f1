"""The equations of motion as a linear regression on smoothed motion: rough values to start a search from.

The equations (Miskovic2007, (4)) are linear in the parameters: :mod:`gcs_autotune.models.coupled.regressors`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import lsq_linear

from gcs_autotune.identify.coupled.smoothing import Motion
from gcs_autotune.identify.likelihood import Limits
from gcs_autotune.identify.special_start import SPECIAL_START
from gcs_autotune.models.coupled import Form
from gcs_autotune.models.coupled.derivatives import SPECIAL
from gcs_autotune.models.coupled.program import program_of
from gcs_autotune.models.coupled.regressors import balance_of

__all__ = ["Regression", "known_theta", "regression_of"]

Array = NDArray[np.float64]

RIDGE = 1e-6
"""Share of each regressor's power added to its own, so that what is not excited stays small."""

ROUNDS = 3
"""Rounds of weighing each driven equation by what it leaves. An equation without inputs keeps its weight: it would
be satisfied best by parameters that are all zero."""

LEAST = 1e-3
"""Smallest remainder of an equation, in shares of the largest known force, that its weight is taken from."""


@dataclass(frozen=True, slots=True, eq=False)
class Regression:
    """``base + J @ values`` are the imbalances (s, k) of the equations; ``names`` (f,) of the values.

    ``theta`` (p,) known parameters and start values, the regressed ones 0; ``usable`` (k,) equations whose velocity
    was measured; ``force`` (k,) rms of the known forces, that of the largest where none is known.
    """

    form: Form
    names: tuple[str, ...]
    theta: Array
    base: Array
    J: Array
    usable: NDArray[np.bool_]
    driven: NDArray[np.bool_]
    force: Array

    @property
    def scales(self) -> Array:
        """Size (f,) of each parameter at which its term is as large as the known forces; 0 where it never acts."""
        rms = np.sqrt(np.mean(self.J**2, axis=0)) / self.force[:, None]
        share = rms.max(axis=0)
        scales: Array = np.where(share > 1e-12, 1.0 / np.maximum(share, 1e-12), 0.0)
        return scales

    def with_values(self, values: Array) -> Array:
        """Return all parameters (p,) with the regressed ones at *values* (f,)."""
        theta = self.theta.copy()
        theta[[self.form.parameters.index(n) for n in self.names]] = values
        return theta

    def solve(self, limits: Limits) -> Array:
        """Return start values (p,) within *limits*, each driven equation weighed by what it leaves."""
        if not self.names:
            return self.theta
        low, high = limits.of(self.names)
        weight = np.where(self.usable, 1.0 / self.force, 0.0)
        values = np.zeros(len(self.names))
        for _ in range(ROUNDS):
            A = (self.J * weight[None, :, None]).reshape(-1, len(self.names))
            values = _bounded(A, -(self.base * weight).ravel(), low, high)
            left = np.sqrt(np.mean((self.base + self.J @ values) ** 2, axis=0))
            weight = np.where(self.driven, 1.0 / np.maximum(left, LEAST * self.force.max()), weight)
        return self.with_values(values)


def known_theta(form: Form) -> Array:
    """Return all parameters (p,): known ones as they are, free ones from ``form.start``, ``SPECIAL_START`` or 0."""
    values = {**{n: s.value for n, s in SPECIAL_START.items()}, **form.start, **form.known}
    return np.array([values.get(n, 0.0) for n in form.parameters])


def regression_of(form: Form, motions: Sequence[Motion], delay: float | None = None) -> Regression:
    """Set up the regression on *motions*; parameters with start values, delay, lag and current stay out of it."""
    theta = known_theta(form)
    if delay is not None and "delay" in form.parameters:
        theta[form.parameters.index("delay")] = delay
    names = tuple(n for n in form.free if n not in SPECIAL and n not in form.start)
    balances = [balance_of(program_of(form), theta, m.X, m.nu_dot, m.inputs) for m in motions]
    base = np.vstack([b.values for b in balances])
    J = np.vstack([b.by for b in balances])[:, :, [form.parameters.index(n) for n in names]]
    usable = np.all([m.known for m in motions], axis=0)
    usable = usable if usable.any() else np.ones_like(usable)
    rms = np.sqrt(np.mean(base**2, axis=0))
    largest = float(rms.max()) or 1.0
    driven = usable & (rms > 1e-9 * largest)
    return Regression(form, names, theta, base, J, usable, driven, np.where(driven, rms, largest))


def _bounded(A: Array, b: Array, low: Array, high: Array) -> Array:
    """Return the least-squares solution within bounds, on the normal equations scaled to unit columns."""
    scale = np.sqrt(np.maximum(np.sum(A * A, axis=0), 1e-300))
    G = (A.T @ A) / np.outer(scale, scale) + RIDGE * np.eye(len(scale))
    R = np.linalg.cholesky(G).T
    target = np.linalg.solve(R.T, A.T @ b / scale)
    if np.all(np.isneginf(low)) and np.all(np.isposinf(high)):
        solution: Array = np.linalg.solve(R, target) / scale
        return solution
    found: Array = lsq_linear(R, target, (low * scale, high * scale)).x / scale
    return found
