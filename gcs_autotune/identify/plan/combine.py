"""Estimates of shared parameters from several steps, combined and compared.

Erunsal2017 takes the plain mean of a shared parameter's estimates (its 3.4). Here each estimate counts by its
information:
with covariances ``P_i`` the combination is ``(sum P_i^-1)^-1 sum P_i^-1 theta_i``, which no other weighting beats and
which also passes on what correlated estimates know of each other. What a step says badly no longer spoils the mean.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gcs_autotune import chi_square
from gcs_autotune.identify.least_squares import inverse_of

__all__ = ["Agreement", "Estimate", "agreements", "combined"]

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Estimate:
    """What one step says: values (k,) of ``names`` and their covariance (k, k), positive definite."""

    step: str
    names: tuple[str, ...]
    values: Array
    covariance: Array


@dataclass(frozen=True, slots=True)
class Agreement:
    """How the steps agree on one shared parameter.

    ``values`` and ``stds`` by step; ``combined`` their information-weighted mean; ``mean`` the plain one of
    Erunsal2017;
    ``probability`` that estimates as far apart come from one value (chi-square).
    """

    name: str
    steps: tuple[str, ...]
    values: tuple[float, ...]
    stds: tuple[float, ...]
    combined: float
    std: float
    mean: float
    probability: float


def combined(estimates: Sequence[Estimate]) -> tuple[tuple[str, ...], Array, Array]:
    """Return all names, the combined values and their covariance."""
    names = tuple(dict.fromkeys(n for e in estimates for n in e.names))
    information, weighted = np.zeros((len(names),) * 2), np.zeros(len(names))
    for e in estimates:
        places = np.array([names.index(n) for n in e.names])
        own = inverse_of(e.covariance)
        information[np.ix_(places, places)] += own
        weighted[places] += own @ e.values
    covariance = inverse_of(information)
    return names, covariance @ weighted, covariance


def agreements(estimates: Sequence[Estimate]) -> tuple[Agreement, ...]:
    """Return one row per parameter that several steps estimated."""
    rows = []
    for name in dict.fromkeys(n for e in estimates for n in e.names):
        own = [e for e in estimates if name in e.names]
        if len(own) < 2:
            continue
        values = np.array([e.values[e.names.index(name)] for e in own])
        stds = np.array([float(np.sqrt(e.covariance[(e.names.index(name),) * 2])) for e in own])
        weights = stds**-2
        middle = float(np.sum(weights * values) / np.sum(weights))
        distance = float(np.sum(weights * (values - middle) ** 2))
        rows.append(
            Agreement(
                name,
                tuple(e.step for e in own),
                tuple(values.tolist()),
                tuple(stds.tolist()),
                middle,
                float(np.sum(weights) ** -0.5),
                float(np.mean(values)),
                chi_square.exceeded_by_chance(distance, len(own) - 1),
            )
        )
    return tuple(rows)
