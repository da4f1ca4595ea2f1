"""Smallest and largest values that parameters may have."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["Limits"]

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Limits:
    """Smallest and largest value allowed per parameter name; unlimited where not named."""

    low: Mapping[str, float]
    high: Mapping[str, float]

    def of(self, names: Sequence[str]) -> tuple[Array, Array]:
        """Return both (p,) in the order of *names*."""
        low = np.array([self.low.get(n, -np.inf) for n in names])
        return low, np.array([self.high.get(n, np.inf) for n in names])

    def within(self, other: Limits) -> Limits:
        """Return the limits that respect both, these first where they contradict each other."""
        low, high = dict(self.low), dict(self.high)
        for name in {*other.low, *other.high}:
            least = max(self.low.get(name, -np.inf), other.low.get(name, -np.inf))
            most = min(self.high.get(name, np.inf), other.high.get(name, np.inf))
            if least < most:
                low[name], high[name] = least, most
        return Limits(low, high)
