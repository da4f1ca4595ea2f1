"""Gauss-Newton with Levenberg-Marquardt damping for residuals that know their Jacobian."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["Minimum", "covariance_of", "minimise"]

Array = NDArray[np.float64]
Residuals = Callable[[Array], tuple[Array, Array] | None]
"""Maps (p,) parameters to weighted residuals (n,) and their Jacobian (n, p); None where it has no value."""

ITERATIONS = 60
"""Most trials before giving up. Chosen: from a usable start five to ten suffice."""

TOLERANCE = 1e-9
"""Relative decrease of the sum of squares below which the search ends: far below any statistical meaning."""


@dataclass(frozen=True, slots=True, eq=False)
class Minimum:
    """Where a search ended: parameters (p,), residuals (n,), Jacobian (n, p), trials, whether it converged."""

    x: Array
    residuals: Array
    jacobian: Array
    iterations: int
    converged: bool

    @property
    def cost(self) -> float:
        """Sum of squared residuals."""
        return float(self.residuals @ self.residuals)


def minimise(residuals: Residuals, start: Array, low: Array, high: Array) -> Minimum | None:
    """Minimise the sum of squares within ``low <= x <= high``; None when *start* itself has no value.

    A parameter on its bound whose gradient points outwards is held for that step.
    """
    x = np.clip(start, low, high)
    first = residuals(x)
    if first is None:
        return None
    r, J = first
    damping, converged, trial = 1e-6, False, 0
    while trial < ITERATIONS:
        trial += 1
        step, expected = _step(r, J, x, low, high, damping)
        moved = np.clip(x + step, low, high)
        cost = float(r @ r)
        after = residuals(moved)
        better = after is not None and float(after[0] @ after[0]) <= cost
        if after is not None and better:
            gain = cost - float(after[0] @ after[0])
            x, (r, J) = moved, after
            damping = max(1e-12, damping * 0.1)
            if gain <= TOLERANCE * cost and expected <= 1e-6 * cost + 1e-300:
                converged = True
                break
        else:
            if expected <= TOLERANCE * cost:
                converged = True
                break
            damping = max(1e-6, damping * 10.0)
            if damping > 1e12:
                break
    return Minimum(x, r, J, trial, converged)


def _step(r: Array, J: Array, x: Array, low: Array, high: Array, damping: float) -> tuple[Array, float]:
    """Return the damped Gauss-Newton step and the decrease it promises."""
    gradient = J.T @ r
    free = ~(((x <= low) & (gradient > 0.0)) | ((x >= high) & (gradient < 0.0)))
    scale = np.sqrt(np.maximum(np.einsum("ij,ij->j", J, J), 1e-300))
    A = (J[:, free] / scale[free]).T @ (J[:, free] / scale[free])
    g = gradient[free] / scale[free]
    s = -np.linalg.solve(A + damping * np.diag(np.diag(A)) + 1e-14 * np.eye(len(g)), g)
    step = np.zeros_like(x)
    step[free] = s / scale[free]
    return step, float(-2.0 * g @ s - s @ A @ s)


def covariance_of(J: Array) -> Array:
    """Return the inverse of ``J'J``, scaled against bad units; what is not informed about gets a huge variance."""
    scale = np.sqrt(np.maximum(np.einsum("ij,ij->j", J, J), 1e-300))
    A = (J / scale).T @ (J / scale)
    values, vectors = np.linalg.eigh(A)
    inverse: Array = (vectors / np.maximum(values, 1e-13)) @ vectors.T / np.outer(scale, scale)
    return inverse
