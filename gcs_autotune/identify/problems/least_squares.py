"""Gauss-Newton search with Levenberg-Marquardt damping.

It minimises any cost with a gradient and a curvature >= 0.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, NamedTuple, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.clock import check_effort

__all__ = ["Local", "Minimum", "Place", "Rules", "descend", "inverse_of", "step_of"]

Array = NDArray[np.float64]


class Local(NamedTuple):
    """Value of a cost at one point, with its derivatives there.

    - ``cost``: the value.
    - ``gradient`` (p,): half the gradient.
    - ``curvature`` (p, p): half the approximate Hessian.
    """

    cost: float
    gradient: Array
    curvature: Array


ITERATIONS = 60
"""Default maximum number of trials of a descent. From a usable start, five to ten suffice. Project choice."""

TOLERANCE = 1e-9
"""Relative decrease of the cost below which a descent ends. Project choice: far below statistical significance."""


class Place(Protocol):
    """Interface of a cost at one point.

    It is a :class:`Local`, or an object that calculates its derivatives on demand.
    """

    @property
    def cost(self) -> float:
        """Value of the cost."""

    @property
    def gradient(self) -> Array:
        """Half the gradient of the cost (p,)."""

    @property
    def curvature(self) -> Array:
        """Half the approximate Hessian of the cost (p, p)."""


@dataclass(frozen=True, slots=True)
class Rules:
    """Rules for the damping of steps and for the end of a descent.

    - ``tolerance``: relative decrease of the cost at which the descent ends. Damping then depends on how well the last
      decrease was predicted (Nielsen1999).
    - ``enough``: decrease of the cost below which the descent ends, used instead of ``tolerance`` if it is not 0.
      Damping then changes by fixed factors, because derivatives are expensive.
    """

    tolerance: float = TOLERANCE
    enough: float = 0.0

    @property
    def limits(self) -> tuple[float, float]:
        """Initial damping, and the damping at which the descent ends."""
        return (1e-3, 1e8) if self.enough else (1e-6, 1e12)

    def eased(self, damping: float, gain_ratio: float) -> float:
        """Return the damping after a step that decreased the cost.

        gain_ratio : ratio of the actual to the predicted decrease.
        """
        if self.enough:
            return max(0.2 * damping, 1e-6)
        return max(1e-12, damping * max(0.1, 1.0 - (2.0 * min(gain_ratio, 1.0) - 1.0) ** 3))

    def raised(self, damping: float, refused: int) -> float:
        """Return the damping after a step that did not decrease the cost.

        refused : number of such steps in a row before this step.
        """
        return max(6.0 * damping, 1e-3) if self.enough else max(1e-6, damping * 4.0 * 2.0**refused)

    def is_there(self, gain: float, expected: float, cost: float) -> bool:
        """Return whether the descent has converged after the cost decreased by *gain* from *cost*.

        expected : predicted decrease.
        """
        if self.enough:
            return gain < self.enough
        return gain <= self.tolerance * cost and expected <= max(self.tolerance, 1e-6) * cost + 1e-300

    def is_in_vain(self, expected: float, here: Place, step: Array) -> bool:
        """Return whether the descent has converged although *step* brought no decrease.

        The descent has converged if the expected decrease is negligible.
        """
        if self.enough:
            # By size: one coordinate cut short may turn the sum, and shorter steps are still to be tried.
            return 2.0 * float(np.abs(here.gradient) @ np.abs(step)) < self.enough
        return expected <= self.tolerance * here.cost


TO_THE_END = Rules()
"""Rules for a descent until full convergence."""

PlaceT = TypeVar("PlaceT", bound=Place)


@dataclass(frozen=True, slots=True, eq=False)
class Minimum(Generic[PlaceT]):
    """Result of a search.

    - ``x`` (p,): parameters.
    - ``cost``: cost at ``x``.
    - ``iterations``: number of trials.
    - ``converged``: whether the search converged.
    - ``place``: cost and derivatives at ``x``.
    """

    x: Array
    cost: float
    iterations: int
    converged: bool
    place: PlaceT


def descend(
    local: Callable[[Array], PlaceT | None],
    start: Array,
    low: Array,
    high: Array,
    *,
    trials: int = ITERATIONS,
    rules: Rules = TO_THE_END,
    rounds: float = math.inf,
    reach: Array | None = None,
) -> Minimum[PlaceT] | None:
    """Minimise a cost within ``low <= x <= high``, and return the minimum, or None if the cost has no value at *start*.

    A parameter on its bound stays fixed for a step if the cost decreases outwards.

    local : returns the cost at a point, or None if it has no value there.
    trials : largest number of steps tried.
    rules : for damping and convergence.
    rounds : largest number of steps that lower the cost.
    reach : (p,) longest step of each parameter.

    Raises
    ------
    OutOfTime
        The :class:`.Effort` is used up before the next trial.
    """
    x = np.clip(start, low, high)
    here = local(x)
    if here is None:
        return None
    damping, most = rules.limits
    refused, converged, trial, lowered = 0, False, 0, 0
    while trial < trials and lowered < rounds:
        check_effort()
        trial += 1
        step, expected = step_of(here, x, low, high, damping, reach)
        moved = np.clip(x + step, low, high)
        after = local(moved)
        if after is not None and after.cost <= here.cost:
            gain, cost = here.cost - after.cost, here.cost
            x, here, lowered, refused = moved, after, lowered + 1, 0
            damping = rules.eased(damping, gain / expected if expected > 0.0 else 1.0)
            if rules.is_there(gain, expected, cost):
                converged = True
                break
        else:
            if rules.is_in_vain(expected, here, step):
                converged = True
                break
            damping, refused = rules.raised(damping, refused), refused + 1
            if damping >= most:
                break
    return Minimum(x, here.cost, trial, converged, here)


def step_of(
    here: Place, x: Array, low: Array, high: Array, damping: float, reach: Array | None = None
) -> tuple[Array, float]:
    """Return the damped Gauss-Newton step (p,) from *x*, and the expected decrease of the cost."""
    gradient = here.gradient
    free = ~(((x <= low) & (gradient > 0.0)) | ((x >= high) & (gradient < 0.0)))
    scale = np.sqrt(np.maximum(np.diag(here.curvature), 1e-300))[free]
    A = here.curvature[np.ix_(free, free)] / np.outer(scale, scale)
    g = gradient[free] / scale
    s = -np.linalg.solve(A + damping * np.diag(np.diag(A)) + 1e-14 * np.eye(len(g)), g)
    step = np.zeros_like(x)
    step[free] = s / scale
    if reach is not None:
        step = np.clip(step, -reach, reach)
    return step, float(-2.0 * g @ s - s @ A @ s)


def inverse_of(information: Array) -> Array:
    """Return the inverse (p, p) of an information matrix. Scaling makes it insensitive to the choice of units.

    Directions without information get a variance of 1e13 in scaled units.
    """
    scale = np.sqrt(np.maximum(np.diag(information), 1e-100))  # its inverse can still be squared
    values, vectors = np.linalg.eigh(information / np.outer(scale, scale))
    inverse: Array = (vectors / np.maximum(values, 1e-13)) @ vectors.T / np.outer(scale, scale)
    return inverse
