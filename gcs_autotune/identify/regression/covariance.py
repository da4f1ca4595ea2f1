"""What coloured residuals cost: the covariance of a sum of correlated scores."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

__all__ = ["scores_covariance"]

Array = NDArray[np.float64]


def scores_covariance(scores: Sequence[Array]) -> Array:
    """Return the covariance (f, f) of the sum of *scores*, (n, f) per series, correlated within each.

    Autocovariances up to ``2*sqrt(n)`` samples with Bartlett weights (Newey and West 1987).
    """
    f = scores[0].shape[1]
    S = np.zeros((f, f))
    for own in scores:
        reach = min(math.ceil(2.0 * math.sqrt(len(own))), len(own) - 1)
        S += own.T @ own
        for k in range(1, reach + 1):
            lagged = own[k:].T @ own[:-k]
            S += (1.0 - k / (reach + 1.0)) * (lagged + lagged.T)
    return S
