"""Maximum likelihood with unknown noise levels.

Parameters and noise are fitted in turn until the noise settles.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.identify.problems.least_squares import Local, Minimum, Rules, descend
from gcs_autotune.identify.problems.likelihood import Residual
from gcs_autotune.identify.problems.noise import NoiseModel

__all__ = ["NOISE_ROUNDS", "Effort", "alternate", "errors_of", "likeliest", "rounding_error"]

Array = NDArray[np.float64]

NOISE_ROUNDS = 4
"""Number of rounds of noise estimation if two kinds of signal are weighted against each other. Project choice."""

SETTLED = 0.01
"""Relative change of the noise levels below which the rounds of estimation end. Project choice."""

MAD = 1.4826
"""Ratio of standard deviation to median magnitude of a normal distribution.

The median magnitude hardly depends on outliers.
"""

LEAST = 1e-100
"""Smallest noise level, for a signal that never changes. The inverse of its square is still finite."""

LOOSE = 1e-4
"""Relative decrease of the cost that ends a round, except the last. Project choice."""


@dataclass(frozen=True, slots=True)
class Effort:
    """Limits for a fit with an expensive cost.

    - ``trials``: maximum number of trials per round. These rounds end with low accuracy.
    - ``exact``: whether the last round has no limit of trials and continues to convergence.
    - ``astray``: multiple of its start value that the noise of a signal may have after two rounds. Above it the fit
      ends.
    """

    trials: int
    exact: bool = True
    astray: float = math.inf


class Cost(Protocol):
    """Interface of the cost that :func:`alternate` minimises: minus twice a log-likelihood, for known noise."""

    def at(self, x: Array, noise: Mapping[str, NoiseModel]) -> Local | None:
        """Return cost, half the gradient and curvature at *x*, or None if the cost has no value at *x*."""

    def residuals(self, x: Array) -> Sequence[Residual] | None:
        """Return the residuals at *x*, or None if there are none."""


def alternate(
    cost: Cost,
    x: Array,
    laws: Mapping[str, NoiseModel],
    low: Array,
    high: Array,
    rounds: int,
    effort: Effort | None = None,
) -> tuple[Minimum[Local], dict[str, NoiseModel]] | None:
    """Fit *x* within its limits, then the noise, at most *rounds* times, and return the minimum and the noise models.

    The result is None if the cost has no value at *x*.

    laws : name of the signal -> noise model at the start.
    """
    minimum: Minimum[Local] | None = None
    first = laws
    for turn in range(rounds):
        now, last = laws, turn == rounds - 1
        at = partial(cost.at, noise=now)
        if effort is None or (last and effort.exact):
            nearer = descend(at, x, low, high)
        else:
            nearer = descend(at, x, low, high, trials=effort.trials, rules=Rules(LOOSE))
        residuals = None if nearer is None else cost.residuals(nearer.x)
        if nearer is None or residuals is None:
            break
        minimum, x, laws = nearer, nearer.x, likeliest(residuals, now)
        settled = all(abs(laws[n].sigma / now[n].sigma - 1.0) < SETTLED for n in laws)
        settled = settled and (effort is None or not effort.exact or nearer.converged)
        if settled and effort is not None and effort.exact and not last:
            minimum = descend(partial(cost.at, noise=laws), x, low, high) or minimum
        astray = effort is not None and turn >= 1 and max(laws[n].sigma / first[n].sigma for n in laws) > effort.astray
        if settled or astray:
            break
    return None if minimum is None else (minimum, dict(laws))


def errors_of(residuals: Sequence[Residual], name: str) -> Array:
    """Return measured minus simulated values (n,) of the signal *name*, joined over all segments."""
    return np.concatenate([r.judged[r.known] for r in residuals if r.signal == name])


def likeliest(
    residuals: Sequence[Residual], laws: Mapping[str, NoiseModel], spent: float = 0.0
) -> dict[str, NoiseModel]:
    """Return name of the signal -> noise model with the level estimated from the residuals.

    spent : degrees of freedom of the fit. They are distributed over the signals in proportion to their numbers of
        samples.
    """
    total = sum(int(r.known.sum()) for r in residuals)
    models = {}
    for name, law in laws.items():
        errors = errors_of(residuals, name)
        left = max(len(errors) * (1.0 - spent / total), 1.0)
        span = max(float(np.ptp(r.measured)) for r in residuals if r.signal == name)
        spread = (
            MAD * float(np.median(np.abs(errors))) * math.sqrt(len(errors))
            if law.robust
            else math.sqrt(errors @ errors)
        )
        level = max(spread / math.sqrt(left), rounding_error(residuals, name), 1e-12 * span, LEAST)
        models[name] = law.likeliest(errors, level)
    return models


def rounding_error(residuals: Sequence[Residual], name: str) -> float:
    """Return the rounding error ``step/sqrt(12)`` of the signal *name*, for its coarsest segment."""
    return max((r.step for r in residuals if r.signal == name), default=0.0) / math.sqrt(12.0)
