"""Gauss-Newton with Levenberg-Marquardt damping, for any cost that knows its gradient and a curvature >= 0."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.clock import check_effort

__all__ = ["Local", "Minimum", "descend", "inverse_of"]

Array = NDArray[np.float64]


class Local(NamedTuple):
    """A cost near one point: its value, half its gradient (p,) and half its (approximate) Hessian (p, p)."""

    cost: float
    gradient: Array
    curvature: Array


ITERATIONS = 60
"""Most trials before giving up. Chosen: from a usable start five to ten suffice."""

TOLERANCE = 1e-9
"""Relative decrease of the cost below which the search ends: far below any statistical meaning."""


@dataclass(frozen=True, slots=True, eq=False)
class Minimum:
    """Where a search ended: parameters (p,), cost, trials, whether it converged."""

    x: Array
    cost: float
    iterations: int
    converged: bool


def descend(
    local: Callable[[Array], Local | None],
    start: Array,
    low: Array,
    high: Array,
    *,
    trials: int = ITERATIONS,
    tolerance: float = TOLERANCE,
) -> Minimum | None:
    """Minimise a cost within ``low <= x <= high``; None when *start* itself has no value.

    A parameter on its bound whose gradient points outwards is held for that step. *local* gives None where the
    cost has no value. *trials* at most, to a relative decrease of *tolerance*.

    The damping follows how well the last decrease was foretold (Nielsen1999).

    Raises
    ------
    OutOfTime
        Within an :class:`.Effort` that is used up, before the next trial.
    """
    x = np.clip(start, low, high)
    here = local(x)
    if here is None:
        return None
    damping, worse, converged, trial = 1e-6, 4.0, False, 0
    while trial < trials:
        check_effort()
        trial += 1
        step, expected = _step(here, x, low, high, damping)
        moved = np.clip(x + step, low, high)
        after = local(moved)
        if after is not None and after.cost <= here.cost:
            gain, cost = here.cost - after.cost, here.cost
            x, here = moved, after
            foretold = gain / expected if expected > 0.0 else 1.0
            damping = max(1e-12, damping * max(0.1, 1.0 - (2.0 * min(foretold, 1.0) - 1.0) ** 3))
            worse = 4.0
            if gain <= tolerance * cost and expected <= max(tolerance, 1e-6) * cost + 1e-300:
                converged = True
                break
        else:
            if expected <= tolerance * here.cost:
                converged = True
                break
            damping, worse = max(1e-6, damping * worse), 2.0 * worse
            if damping > 1e12:
                break
    return Minimum(x, here.cost, trial, converged)


def _step(here: Local, x: Array, low: Array, high: Array, damping: float) -> tuple[Array, float]:
    """Return the damped Gauss-Newton step and the decrease it promises."""
    gradient = here.gradient
    free = ~(((x <= low) & (gradient > 0.0)) | ((x >= high) & (gradient < 0.0)))
    scale = np.sqrt(np.maximum(np.diag(here.curvature), 1e-300))[free]
    A = here.curvature[np.ix_(free, free)] / np.outer(scale, scale)
    g = gradient[free] / scale
    s = -np.linalg.solve(A + damping * np.diag(np.diag(A)) + 1e-14 * np.eye(len(g)), g)
    step = np.zeros_like(x)
    step[free] = s / scale
    return step, float(-2.0 * g @ s - s @ A @ s)


def inverse_of(information: Array) -> Array:
    """Return the inverse of an information matrix, scaled against bad units; directions without any get 1e13."""
    scale = np.sqrt(np.maximum(np.diag(information), 1e-100))  # its inverse can still be squared
    values, vectors = np.linalg.eigh(information / np.outer(scale, scale))
    inverse: Array = (vectors / np.maximum(values, 1e-13)) @ vectors.T / np.outer(scale, scale)
    return inverse
