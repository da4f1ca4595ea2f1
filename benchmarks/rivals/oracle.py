"""The oracle: a search for the best gains on the true hull with the firmware's own loop."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from gcs_autotune.design import StepMetrics

__all__ = ["Flight", "search"]

_AGAIN = 3
"""Number of best gains that are flown again, so that a single lucky step does not win."""
_LEAST = 1e-3
"""Substitute for 0 in the search over logarithms, as a fraction of the upper end of a range."""
_SPREAD = 0.4
"""Size of the first simplex, in logarithms of the gains."""
_RESTART = 0.8
"""Size of the simplex of a search that restarts at the best gains."""
_PRICE = 20.0
"""Penalty of overshoot beyond the limit: each 1 % counts as 20 % more ITAE."""
_NO_ITAE = 1e6
"""Substitute for an ITAE that could not be measured."""

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Flight:
    """Gains, and the mean metrics of their flights."""

    gains: Mapping[str, float]
    itae: float
    overshoot: float

    def cost(self, max_overshoot: float) -> float:
        """Return the ITAE, with a penalty for overshoot beyond *max_overshoot* (fraction of the step)."""
        error = self.itae if math.isfinite(self.itae) else _NO_ITAE
        return error * (1.0 + _PRICE * max(0.0, self.overshoot - max_overshoot))


class _Flights:
    """All flights, by the logarithms of their gains."""

    def __init__(
        self, fly: Callable[[Mapping[str, float]], StepMetrics], ranges: Mapping[str, tuple[float, float]]
    ) -> None:
        self.fly, self.names, self.ranges = fly, list(ranges), ranges
        self.low = np.array([max(ranges[n][0], _LEAST * ranges[n][1]) for n in self.names])
        self.high = np.array([ranges[n][1] for n in self.names])
        self.flights: dict[tuple[float, ...], Flight] = {}

    def at(self, gains: Mapping[str, float]) -> Array:
        """Return the logarithms of *gains*, clipped to the ranges."""
        values = [gains.get(n, low) for n, low in zip(self.names, self.low, strict=True)]
        place: Array = np.log(np.clip(values, self.low, self.high))
        return place

    def flight(self, x: Array) -> Flight:
        """Return the flight of the gains closest to *x* (n,) inside the ranges; fly it if there is none yet."""
        inside = np.clip(np.exp(x), self.low, self.high)
        key = tuple(np.round(np.log(inside), 6))
        if key not in self.flights:
            gains = {
                n: 0.0 if v <= low * (1.0 + 1e-9) and self.ranges[n][0] == 0.0 else float(v)
                for n, v, low in zip(self.names, inside, self.low, strict=True)
            }
            m = self.fly(gains)
            self.flights[key] = Flight(gains, m.itae, m.overshoot)
        return self.flights[key]

    def outside(self, x: Array) -> float:
        """Return how far *x* lies outside the ranges."""
        return float((np.maximum(x - np.log(self.high), 0.0) + np.maximum(np.log(self.low) - x, 0.0)).sum())


def search(
    fly: Callable[[Mapping[str, float]], StepMetrics],
    ranges: Mapping[str, tuple[float, float]],
    starts: Sequence[Mapping[str, float]],
    budget: int,
    limits: Sequence[float],
) -> tuple[list[Flight], int]:
    """Return (the best gains for each of *limits* of overshoot, steps flown).

    fly : flies a step with given gains. ranges : of the gains. starts : gains that are flown first, those of the other
    rules among them. None of these inside the ranges can thus beat the oracle by more than two flights of the same
    gains differ. limits : largest overshoot [fraction of the step] of each result; ``inf``: none.

    The search is Nelder-Mead on the logarithms of the gains. For each limit it starts at the best start, and restarts
    with another simplex at the best gains until the *budget* of flights is used. All flights count for all limits. The
    best few of each are flown again.
    """
    flights = _Flights(fly, ranges)
    for start in starts:
        flights.flight(flights.at(start))
    for k, limit in enumerate(limits):
        share = len(flights.flights) + (budget - len(flights.flights)) // (len(limits) - k)
        spread = _SPREAD
        while share - len(flights.flights) > len(flights.names) + 1:
            before = len(flights.flights)
            _descend(flights, limit, spread, share - before)
            spread = _RESTART if spread == _SPREAD else _SPREAD
            if len(flights.flights) == before:
                break
    flown = len(flights.flights)
    answers = []
    for limit in limits:
        best = sorted(flights.flights, key=lambda key: flights.flights[key].cost(limit))[:_AGAIN]
        for key in best:
            first, again = flights.flights[key], flights.fly(flights.flights[key].gains)
            flown += 1
            flights.flights[key] = Flight(
                first.gains, 0.5 * (first.itae + again.itae), max(first.overshoot, again.overshoot)
            )
        answers.append(min((flights.flights[key] for key in best), key=lambda flight: flight.cost(limit)))
    return answers, flown


def _descend(flights: _Flights, limit: float, spread: float, most: int) -> None:
    start = flights.at(min(flights.flights.values(), key=lambda flight: flight.cost(limit)).gains)
    n = len(start)
    inward = np.where(start + spread <= np.log(flights.high), spread, -spread)
    simplex = np.vstack([start, start + np.diag(inward)])
    minimize(
        lambda x: flights.flight(x).cost(limit) * (1.0 + flights.outside(x)),
        start,
        method="Nelder-Mead",
        options={"initial_simplex": simplex, "maxfev": most, "xatol": 0.02, "fatol": 1e-3, "adaptive": n > 4},
    )
