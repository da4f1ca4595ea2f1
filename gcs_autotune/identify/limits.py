"""Lower and upper limits of parameters."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["Limits"]

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Limits:
    """Lower and upper limit per parameter name; parameters not listed are unlimited."""

    low: Mapping[str, float]
    high: Mapping[str, float]

    def of(self, names: Sequence[str]) -> tuple[Array, Array]:
        """Return the lower and the upper limits (p,) in the order of *names*."""
        low = np.array([self.low.get(n, -np.inf) for n in names])
        return low, np.array([self.high.get(n, np.inf) for n in names])

    def within(self, other: Limits) -> Limits:
        """Return limits that satisfy these and *other*.

        Where they contradict each other, these limits apply.
        """
        low, high = dict(self.low), dict(self.high)
        for name in {*other.low, *other.high}:
            least = max(self.low.get(name, -np.inf), other.low.get(name, -np.inf))
            most = min(self.high.get(name, np.inf), other.high.get(name, np.inf))
            if least < most:
                low[name], high[name] = least, most
        return Limits(low, high)
