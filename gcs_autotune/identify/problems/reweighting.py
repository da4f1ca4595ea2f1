"""Maximum likelihood with unknown noise levels: fit parameters and noise in turn until the noise settles."""

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
"""Rounds of re-estimating the noise levels when two kinds of signal are weighed against each other."""

SETTLED = 0.01
"""Relative change of every noise level at which the rounds end."""

MAD = 1.4826
"""Standard deviation over median magnitude, of a Gaussian: outliers hardly move the latter."""

LEAST = 1e-100
"""Least noise level of a signal that never changes; its square still has an inverse."""

LOOSE = 1e-4
"""Relative decrease that ends a round which is not the last."""


@dataclass(frozen=True, slots=True)
class Effort:
    """Effort limits for an expensive cost.

    ``trials``: per round except the last, which end with low accuracy. ``exact``: the last round continues to
    convergence. ``astray``: the fit ends after two rounds if some signal's noise still exceeds this multiple of its
    start value.
    """

    trials: int
    exact: bool = True
    astray: float = math.inf


class Cost(Protocol):
    """What :func:`alternate` minimises: minus twice a log-likelihood of one vector, given the noise."""

    def at(self, x: Array, noise: Mapping[str, NoiseModel]) -> Local | None:
        """Return cost, gradient and curvature at *x*, None when it has no value there."""

    def residuals(self, x: Array) -> Sequence[Residual] | None:
        """Return the residuals at *x*, None when there are none."""


def alternate(
    cost: Cost,
    x: Array,
    laws: Mapping[str, NoiseModel],
    low: Array,
    high: Array,
    rounds: int,
    effort: Effort | None = None,
) -> tuple[Minimum[Local], dict[str, NoiseModel]] | None:
    """Fit *x* within its limits, then the noise of every law, *rounds* times at most; None when *x* has no value."""
    found: Minimum[Local] | None = None
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
        found, x, laws = nearer, nearer.x, likeliest(residuals, now)
        settled = all(abs(laws[n].sigma / now[n].sigma - 1.0) < SETTLED for n in laws)
        settled = settled and (effort is None or not effort.exact or nearer.converged)
        if settled and effort is not None and effort.exact and not last:
            found = descend(partial(cost.at, noise=laws), x, low, high) or found
        astray = effort is not None and turn >= 1 and max(laws[n].sigma / first[n].sigma for n in laws) > effort.astray
        if settled or astray:
            break
    return None if found is None else (found, dict(laws))


def errors_of(residuals: Sequence[Residual], name: str) -> Array:
    """Return measured minus simulated of all signals called *name*, one after the other."""
    return np.concatenate([r.judged[r.known] for r in residuals if r.signal == name])


def likeliest(
    residuals: Sequence[Residual], laws: Mapping[str, NoiseModel], spent: float = 0.0
) -> dict[str, NoiseModel]:
    """Return the laws with their noise re-estimated, *spent* degrees of freedom shared out by sample counts."""
    total = sum(int(r.known.sum()) for r in residuals)
    found = {}
    for name, law in laws.items():
        errors = errors_of(residuals, name)
        left = max(len(errors) * (1.0 - spent / total), 1.0)
        swing = max(float(np.ptp(r.measured)) for r in residuals if r.signal == name)
        spread = (
            MAD * float(np.median(np.abs(errors))) * math.sqrt(len(errors))
            if law.robust
            else math.sqrt(errors @ errors)
        )
        level = max(spread / math.sqrt(left), rounding_error(residuals, name), 1e-12 * swing, LEAST)
        found[name] = law.likeliest(errors, level)
    return found


def rounding_error(residuals: Sequence[Residual], name: str) -> float:
    """Return the rounding error of the coarsest sensor called *name*: ``step/sqrt(12)``."""
    return max((r.step for r in residuals if r.signal == name), default=0.0) / math.sqrt(12.0)
