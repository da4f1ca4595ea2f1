"""Are the runs of one craft? Each is identified by itself and compared with the others, for any method.

The difference of two independent estimates, weighed with both covariances, is chi-squared distributed when the craft
is the same. The run furthest from the rest is taken out and the remaining ones are compared again. Constant forces,
current and delay belong to the day, not to the craft: leave them out of the estimates.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gcs_autotune import chi_square
from gcs_autotune.identify.result import Doubt

__all__ = ["Apart", "CraftEstimate", "apart_doubts", "runs_apart"]

Array = NDArray[np.float64]

SIGMAS = 6.0
"""Chosen: a run counts as apart when its distance is less likely than six standard errors of one number."""
CHANGE = 0.20
"""And when a parameter differs by this share: two long runs of one craft show small differences of no account."""


@dataclass(frozen=True, slots=True, eq=False)
class CraftEstimate:
    """What some of the runs say about the craft: ``values`` (p,), ``covariance`` (p, p)."""

    values: Array
    covariance: Array


@dataclass(frozen=True, slots=True)
class Apart:
    """A run that speaks of another craft, ``sigmas`` standard errors from the others; ``change`` of the parameter
    that differs most, as a share. ``pair`` holds both names when there are only two runs and either may be the odd one.
    """

    run: str
    sigmas: float
    change: float
    pair: tuple[str, str] | None = None


def runs_apart(
    names: Sequence[str], estimate: Callable[[tuple[int, ...]], CraftEstimate | None], sigmas: float = SIGMAS
) -> tuple[Apart, ...]:
    """Return the runs that do not belong to the others.

    Parameters
    ----------
    names : of the runs.
    estimate : what the runs of these indices say together; None when they cannot tell.
    """
    alone = [estimate((i,)) for i in range(len(names))]
    left = [i for i, found in enumerate(alone) if found is not None]
    odd: list[Apart] = []
    while len(left) >= 2:
        distances = [_distance(alone[i], estimate(tuple(j for j in left if j != i)), sigmas) for i in left]
        k = int(np.argmax([d for d, _ in distances]))
        distance, change = distances[k]
        if distance <= 0.0:
            break
        pair = (names[left[0]], names[left[1]]) if len(left) == 2 and not odd else None
        odd.append(Apart(names[left[k]], distance, change, pair))
        del left[k]
    return tuple(odd)


def _distance(one: CraftEstimate | None, rest: CraftEstimate | None, sigmas: float) -> tuple[float, float]:
    """Return distance in standard errors and largest relative change; zeros when they agree or cannot be compared."""
    if one is None or rest is None:
        return 0.0, 0.0
    difference = one.values - rest.values
    together = one.covariance + rest.covariance
    spread = np.sqrt(np.maximum(np.diag(together), 0.0))
    known = np.isfinite(spread) & (spread > 0.0)
    if not known.any():
        return 0.0, 0.0
    d, scale = difference[known] / spread[known], spread[known]
    correlation = together[np.ix_(known, known)] / np.outer(scale, scale)
    square = float(d @ np.linalg.pinv(correlation, rcond=1e-9, hermitian=True) @ d)
    limit = chi_square.threshold(chi_square.exceeded_by_chance(sigmas**2, 1), int(known.sum()))
    certain = np.abs(d) > 3.0
    size = np.maximum(np.abs(rest.values[known]), 1e-300)
    change = float(np.max(np.abs(difference[known]) / size, where=certain, initial=0.0))
    if square <= limit or change <= CHANGE:
        return 0.0, 0.0
    return math.sqrt(square), change


def apart_doubts(found: Sequence[Apart]) -> list[Doubt]:
    """Return one doubt per run apart, the run named."""
    return [
        Doubt(
            "run-apart",
            f"runs '{a.pair[0]}' and '{a.pair[1]}' differ by {a.sigmas:.0f} standard errors: they speak of two crafts"
            if a.pair
            else f"run '{a.run}' differs from the others by {a.sigmas:.0f} standard errors: it speaks of another craft",
            "was it another vehicle, load, speed or battery? identify the odd run by itself",
        )
        for a in found
    ]
