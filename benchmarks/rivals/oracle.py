"""The oracle: gains searched for on the truth, with the firmware's own loop, as long as it takes."""

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
"""The best so many are flown once more: one lucky step must not win."""
_LEAST = 1e-3
"""Of the upper end of a range: what stands for 0 where gains are searched by their logarithm."""
_SPREAD = 0.4
"""First simplex, in logarithms of gains: half as much again."""
_RESTART = 0.8
"""The same where the search begins again about the best so far."""
_PRICE = 20.0
"""Overshoot beyond the limit: each 1 % counts like 20 % more error."""
_STRAY = 1e6
"""Stands in for an error that could not be measured."""

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Flight:
    """Gains, and the steps they gave: the mean of all flights of them."""

    gains: Mapping[str, float]
    itae: float
    overshoot: float

    def cost(self, max_overshoot: float) -> float:
        """Return the error, raised where the overshoot is beyond *max_overshoot* (a share of the step)."""
        error = self.itae if math.isfinite(self.itae) else _STRAY
        return error * (1.0 + _PRICE * max(0.0, self.overshoot - max_overshoot))


class _Book:
    """Every flight, by where it was in the logarithms of the gains."""

    def __init__(
        self, fly: Callable[[Mapping[str, float]], StepMetrics], ranges: Mapping[str, tuple[float, float]]
    ) -> None:
        self.fly, self.names, self.ranges = fly, list(ranges), ranges
        self.low = np.array([max(ranges[n][0], _LEAST * ranges[n][1]) for n in self.names])
        self.high = np.array([ranges[n][1] for n in self.names])
        self.flights: dict[tuple[float, ...], Flight] = {}

    def at(self, gains: Mapping[str, float]) -> Array:
        """Return where *gains* are, moved into the ranges."""
        wish = [gains.get(n, low) for n, low in zip(self.names, self.low, strict=True)]
        place: Array = np.log(np.clip(wish, self.low, self.high))
        return place

    def flight(self, x: Array) -> Flight:
        """Return the flight of the gains nearest to *x* (n,) inside the ranges, flown now if it was not before."""
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

    fly : flies a step under gains. ranges : of the gains. starts : gains flown first, the rivals' among them, so that
    none of them inside the ranges can beat the oracle by more than two flights of the same gains differ.
    limits : overshoot [share of the step] each answer is held to, ``inf`` for free. Nelder-Mead on the logarithms of
    the gains, for each limit from its best start and then again, with a wider simplex, from the best so far, until the
    *budget* of flights is spent; all flights count for all limits. The best few of each are flown again.
    """
    book = _Book(fly, ranges)
    for start in starts:
        book.flight(book.at(start))
    for k, limit in enumerate(limits):
        share = len(book.flights) + (budget - len(book.flights)) // (len(limits) - k)
        spread = _SPREAD
        while share - len(book.flights) > len(book.names) + 1:
            before = len(book.flights)
            _descend(book, limit, spread, share - before)
            spread = _RESTART if spread == _SPREAD else _SPREAD
            if len(book.flights) == before:
                break
    flown = len(book.flights)
    answers = []
    for limit in limits:
        best = sorted(book.flights, key=lambda key: book.flights[key].cost(limit))[:_AGAIN]
        for key in best:
            first, again = book.flights[key], book.fly(book.flights[key].gains)
            flown += 1
            book.flights[key] = Flight(
                first.gains, 0.5 * (first.itae + again.itae), max(first.overshoot, again.overshoot)
            )
        answers.append(min((book.flights[key] for key in best), key=lambda flight: flight.cost(limit)))
    return answers, flown


def _descend(book: _Book, limit: float, spread: float, most: int) -> None:
    start = book.at(min(book.flights.values(), key=lambda flight: flight.cost(limit)).gains)
    n = len(start)
    inward = np.where(start + spread <= np.log(book.high), spread, -spread)
    simplex = np.vstack([start, start + np.diag(inward)])
    minimize(
        lambda x: book.flight(x).cost(limit) * (1.0 + book.outside(x)),
        start,
        method="Nelder-Mead",
        options={"initial_simplex": simplex, "maxfev": most, "xatol": 0.02, "fatol": 1e-3, "adaptive": n > 4},
    )
