"""Log-likelihood gained on data left out, with process noise modelled, and its 90 % interval."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from gcs_autotune.diagnose.heldout import BLOCKS, FEWEST
from gcs_autotune.identify import WanderingFit

__all__ = ["densities_of", "interval_of"]

Array = NDArray[np.float64]

RUNS_AWAY = -1e6
"""Log density of a sample on which a model runs away."""

FAR_ROUGHER = 2.0
"""Chosen: squares of innovations on data left out, over what the other runs' fit expects, from which on its weather is
another's."""

FEWEST_WHOLES = 4
"""Chosen: parts left out, of which the scatter tells something: two or three are alike by accident."""

SURE = 0.95
"""Quantile at either end of a 90 % interval: a gain is none in one case of twenty."""


def densities_of(fits: Sequence[WanderingFit | None], plain: Sequence[WanderingFit | None]) -> list[Array]:
    """Return the log densities (samples,) of what each fold leaves out, under the weather that *plain* shows there.

    Where that is far rougher than the other runs' (a gust, a glitch, a worse day), it is so for every candidate:
    by the others' calm, a few samples would outweigh all there is, to either side.
    """
    found = []
    for fit, base in zip(fits, plain, strict=True):
        rougher = 1.0 if base is None or base.roughness < FAR_ROUGHER else base.roughness
        found.append(np.full(1, RUNS_AWAY) if fit is None else fit.densities(rougher))
    return found


def interval_of(before: Sequence[Array], after: Sequence[Array]) -> tuple[float, float]:
    """Return the 90 % interval of the log-likelihood gained on all that is left out: of two the narrower.

    From its scatter over blocks, for a single gust, or one manoeuvre, may bring all of a gain; and over what is left
    out in turn: a noise level fitted anew takes from lively blocks what it gives to quiet ones, in every run alike.
    """
    size = max(FEWEST, sum(map(len, before)) // BLOCKS)
    wholes, sums = [], []
    for old, new in zip(before, after, strict=True):
        d = new - old
        wholes.append(float(np.sum(d)))
        sums += [float(np.sum(part)) for part in np.array_split(d, max(1, len(d) // size))]
    half = _half_width(sums)
    if len(wholes) >= FEWEST_WHOLES:
        half = min(half, _half_width(wholes))
    return sum(wholes) - half, sum(wholes) + half


def _half_width(parts: Sequence[float]) -> float:
    """Return half the 90 % interval of the sum of *parts*, by Student's law of their scatter."""
    n = len(parts)
    return float(stdtrit(n - 1, SURE)) * math.sqrt(n * float(np.var(parts, ddof=1))) if n > 1 else math.inf
