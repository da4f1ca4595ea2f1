"""Whether a signal has come to rest: what a flown step waits for, and what the prediction of that step waits for."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

__all__ = ["LOOK", "TRIFLE", "is_at_rest"]

LOOK = 3.0
"""Chosen [s]: so much is looked at."""
TRIFLE = 0.01
"""Fraction of the step, and of full output, that is negligible. Chosen."""
TRIFLE_NOISES = 2.0
"""Standard deviations of the noise that are negligible. Chosen."""


def is_at_rest(
    t: NDArray[np.float64],
    x: NDArray[np.float64],
    seconds: float,
    trifle: float,
    noise: float,
    *,
    unseen: float = 0.0,
) -> bool:
    """Return whether *x* (n,) at *t* (n,) [s] has settled for the next *seconds*.

    Neither its extrapolated linear trend nor its scatter about that trend (waves, a limit cycle) may exceed
    a *trifle* or the *noise* from sample to sample; both are in the unit of *x*, as is ``unseen``, the standard
    deviation of noise that a measured signal has and a simulated one lacks.
    """
    since, off = t - t.mean(), x - x.mean()
    pace = float(since @ off / (since @ since))
    scatter = math.sqrt(float(np.mean((off - pace * since) ** 2)) + unseen**2)
    return max(abs(pace) * seconds, scatter) <= max(trifle, TRIFLE_NOISES * noise)
