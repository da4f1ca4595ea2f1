"""Detect whether a signal has settled, for a flown step and for the prediction of that step."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

__all__ = ["LOOK", "TRIFLE", "is_at_rest"]

LOOK = 3.0
"""Length of the signal that is evaluated [s]. Project choice."""
TRIFLE = 0.01
"""Negligible change as a fraction of the step and of full output. Project choice."""
TRIFLE_NOISES = 2.0
"""Negligible change in standard deviations of the noise. Project choice."""


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

    Neither its extrapolated linear trend nor its scatter about that trend (waves, a limit cycle) may exceed a *trifle*
    or the *noise* from sample to sample. Both are in the unit of *x*. So is ``unseen``, the standard deviation of noise
    that a measured signal has but a simulated one does not.
    """
    since, off = t - t.mean(), x - x.mean()
    pace = float(since @ off / (since @ since))
    scatter = math.sqrt(float(np.mean((off - pace * since) ** 2)) + unseen**2)
    return max(abs(pace) * seconds, scatter) <= max(trifle, TRIFLE_NOISES * noise)
