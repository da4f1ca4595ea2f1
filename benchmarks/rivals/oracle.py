"""The oracle: gains searched for on the truth, with the firmware's own loop, as long as it takes."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence

import numpy as np
from scipy.optimize import minimize

__all__ = ["search"]

_AGAIN = 3
"""The best so many are flown once more: one lucky step must not win."""
_LEAST = 1e-3
"""Of the upper end of a range: what stands for 0 where gains are searched by their logarithm."""


def search(
    fly: Callable[[Mapping[str, float]], float],
    ranges: Mapping[str, tuple[float, float]],
    starts: Sequence[Mapping[str, float]],
    budget: int,
) -> tuple[dict[str, float], float, int]:
    """Return (gains of the least error, that error, steps flown): Nelder-Mead on log gains from each start.

    *fly* returns the error of a step under these gains. The gains stay within *ranges*; all *starts* (within them) are
    flown first, the searches begin at the best two, the second with what the first has left of the *budget*; the best
    few are flown again.
    """
    names = list(ranges)
    low = np.array([max(ranges[n][0], _LEAST * ranges[n][1]) for n in names])
    high = np.array([ranges[n][1] for n in names])
    tried: dict[tuple[float, ...], float] = {}
    flown: dict[tuple[float, ...], dict[str, float]] = {}

    def gains_of(x: np.ndarray) -> dict[str, float]:
        inside = np.clip(np.exp(x), low, high)
        return {
            n: 0.0 if v <= low[k] and ranges[n][0] == 0.0 else float(v)
            for k, (n, v) in enumerate(zip(names, inside, strict=True))
        }

    def cost(x: np.ndarray) -> float:
        gains = gains_of(x)
        key = tuple(round(math.log(max(v, 1e-9)), 6) for v in gains.values())
        if key not in tried:
            error = fly(gains)
            flown[key] = gains
            tried[key] = error if math.isfinite(error) else 1e6
        outside = np.maximum(x - np.log(high), 0.0) + np.maximum(np.log(low) - x, 0.0)
        return tried[key] * (1.0 + float(outside.sum()))

    points = [np.log(np.clip([start.get(n, low[k]) for k, n in enumerate(names)], low, high)) for start in starts]
    points.sort(key=cost)
    for start in points[:2]:
        left = budget - len(tried)
        if left <= len(names) + 1:
            break
        simplex = np.array(
            [
                start,
                *(
                    start + 0.4 * np.eye(len(names))[k] * (1 if start[k] + 0.4 <= np.log(high[k]) else -1)
                    for k in range(len(names))
                ),
            ]
        )
        share = left if start is points[-1] or start is not points[0] else math.ceil(0.6 * left)
        minimize(
            cost,
            start,
            method="Nelder-Mead",
            options={"initial_simplex": simplex, "maxfev": share, "xatol": 0.01, "fatol": 1e-4, "adaptive": True},
        )
    names_of_best = sorted(tried, key=lambda key: tried[key])[:_AGAIN]
    again = {key: 0.5 * (tried[key] + fly(flown[key])) for key in names_of_best}
    chosen = min(again, key=lambda key: again[key])
    return flown[chosen], again[chosen], len(tried) + len(again)
