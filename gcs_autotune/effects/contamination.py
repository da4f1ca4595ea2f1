"""Errors of which a share is far larger than the rest: a mixture of two normal laws, found by expectation-maximisation.

The contaminated normal law: Tukey1960; the algorithm: Dempster1977.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter

from gcs_autotune.slow_imports import scipy_stats

__all__ = ["Contamination", "contamination", "stray", "without_motion"]

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

WINDOW = 7
"""Samples a lone deviation is held against."""
MOST, LEAST_SIZE = 0.3, 3.0
"""Chosen: outliers are at most this share of the samples, and at least so many times the noise."""
DOUBT = 1e-3
"""Chance of taking outliers that strike anywhere for ones that do not."""
SWEEPS = 60


@dataclass(frozen=True, slots=True)
class Contamination:
    """A ``share`` of the errors has rms ``size`` on top of the noise ``level`` all have."""

    share: float
    size: float
    level: float

    def odds(self, error: Array) -> Array:
        """Return log odds (n,) that an error is one of the share."""
        variance = self.level**2 + self.size**2
        narrow = math.log1p(-self.share) - math.log(self.level) - 0.5 * (error / self.level) ** 2
        broad = math.log(self.share) - 0.5 * math.log(variance) - 0.5 * error**2 / variance
        odds: Array = broad - narrow
        return odds

    def flags(self, error: Array) -> Flags:
        """Return which errors (n,) are rather than not of the share."""
        return np.asarray(self.odds(error) > 0.0)

    def density(self, error: Array) -> Array:
        """Return the density (n,) of the mixture."""
        variances = (self.level**2, self.level**2 + self.size**2)
        bells = [np.exp(-0.5 * error**2 / v) / math.sqrt(2.0 * math.pi * v) for v in variances]
        return np.asarray((1.0 - self.share) * bells[0] + self.share * bells[1])


def stray(error: Array) -> Array:
    """Return errors (n,) against the median of their neighbours: what of them stands alone."""
    return np.asarray(error - median_filter(error, size=min(WINDOW, len(error)), mode="nearest"))


def contamination(error: Array) -> Contamination | None:
    """Return the mixture *error* (n,) speaks for; None when there is no share of larger ones."""
    error = error[np.isfinite(error)]
    if len(error) < 20:
        return None
    # Kept off zero: of noise-free readings with a few off, the rest is rounding.
    floor = 1e-9 * float(np.max(np.abs(error)))
    level = max(1.4826 * float(np.median(np.abs(error))), floor)
    far = np.abs(error) > 4.0 * level
    if floor == 0.0 or not far.any():
        return None
    share = float(np.mean(far))
    size = math.sqrt(float(np.mean(error[far] ** 2)))
    for _ in range(SWEEPS):
        if share > MOST or share * len(error) < 1.0 or size < LEAST_SIZE * level:
            return None
        law = Contamination(share, size, level)
        broad = 0.5 * (1.0 + np.tanh(0.5 * np.clip(law.odds(error), -600.0, 600.0)))
        share = float(np.mean(broad))
        level = max(math.sqrt(float((1.0 - broad) @ error**2) / float(np.sum(1.0 - broad))), floor)
        variance = float(broad @ error**2) / max(float(np.sum(broad)), 1e-300)
        size = math.sqrt(max(variance - level**2, 0.0))
    return Contamination(share, size, level) if 0.0 < share <= MOST and size >= LEAST_SIZE * level else None


def without_motion(flags: Sequence[Flags], motion: Sequence[Array]) -> bool:
    """Return whether flagged samples strike anywhere: not where the motion (n,) of a run changes fast, not in flocks.

    By the rank test of Mann and Whitney on the motion's change, and by how many have a flagged neighbour.
    """
    change = np.concatenate([_rank(np.abs(np.gradient(m))) for m in motion])
    off = np.concatenate(list(flags))
    if off.sum() < 3 or off.all():
        return bool(off.any()) and not bool(off.all())
    neighbours = sum(int(np.sum(f[1:] & f[:-1])) for f in flags)
    expected = sum(max(float(f.mean()) ** 2, float(off.mean()) ** 2) * len(f) for f in flags)
    if float(scipy_stats().poisson.sf(neighbours - 1, expected)) < DOUBT:
        return False
    return float(scipy_stats().mannwhitneyu(change[off], change[~off], alternative="greater").pvalue) > DOUBT


def _rank(x: Array) -> Array:
    return np.asarray(np.argsort(np.argsort(x)) / max(len(x), 1), dtype=np.float64)
