"""A second look in pieces, when nothing pays over whole runs.

On real water a free run drifts off within minutes, whatever the model: gusts and eddies add up in the heading. Where
the base is lost, every candidate is, and none seems to pay. Cut into pieces that begin where the craft was measured to
be, the same runs may speak. What they name is a hypothesis, and dropped unless whole runs are then foretold better too.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from gcs_autotune.diagnose.heldout import rms_of
from gcs_autotune.diagnose.search import Search
from gcs_autotune.identify.extended.fitting import Fitted
from gcs_autotune.identify.segment import Segment

__all__ = ["FAR", "foretells", "holds_over", "horizon_for"]

PACES = 30.0
"""Chosen: a piece lasts so many of the base model's slowest time constants; all it can show settles many times over."""

FAR = 1.5
"""Error of runs a model was not fitted to, over the noise of those it was, beyond which it does not hold for them."""

FEWEST = 2
"""Fewest pieces of the longest run worth a second look."""


def horizon_for(search: Search) -> float | None:
    """Return how long pieces are to be [s]; None when the runs are no longer than that anyway."""
    horizon = PACES * search.problem.scene.pace
    return horizon if search.problem.scene.duration >= FEWEST * horizon else None


def holds_over(search: Search, whole: Sequence[Segment]) -> bool:
    """Whether what *search* found lowers the error over *whole* runs too, all signals together."""
    before, after = (_error(search, fitted, whole) for fitted in (search.base, search.fitted))
    if after is None:
        return False
    if before is None:
        return True
    logs = [math.log(max(after[n], 1e-300) / before[n]) for n in before if before[n] > 0.0]
    return bool(logs) and float(np.mean(logs)) < 0.0


def foretells(search: Search, whole: Sequence[Segment]) -> bool:
    """Whether the model found in pieces leaves no more than :data:`FAR` times their noise over *whole* runs as well."""
    errors = _error(search, search.fitted, whole)
    return errors is not None and all(errors[n] <= FAR * level for n, level in search.fitted.levels.items())


def _error(search: Search, fitted: Fitted, whole: Sequence[Segment]) -> dict[str, float] | None:
    problem = search.problem.on(whole)
    found = problem.states(fitted.theta, fitted.effects, problem.first_states(whole))
    return None if found is None else rms_of(found.rests)
