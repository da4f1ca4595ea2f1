"""Find correlated terms, whose parameters these runs cannot distinguish (variance inflation)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.identify.doubt import Doubt
from gcs_autotune.identify.problems.least_squares import inverse_of
from gcs_autotune.identify.regression.solver import Estimate

__all__ = ["collinearity_doubts", "inflation_factors"]

Array = NDArray[np.float64]

TOO_MUCH = 100.0
"""Variance inflation above which two terms are reported as correlated. 99 % of one term is then a combination of the
others."""

SHARE = 0.3
"""Smallest component of a parameter in the least observable direction for which the parameter is listed in the doubt.
"""


def inflation_factors(information: Array) -> Array:
    """Return the variance inflation factor (f,) of each parameter, 1 for an uncorrelated term."""
    factors: Array = np.diag(information) * np.diag(inverse_of(information))
    return factors


def collinearity_doubts(estimate: Estimate) -> list[Doubt]:
    """Return doubts about parameters that cannot be distinguished or that the runs do not excite."""
    information, names = estimate.information, estimate.equations.form.free
    doubts: list[Doubt] = []
    dead = np.diag(information) <= 0.0
    if np.any(dead):
        doubts.append(
            Doubt(
                "not-excited",
                f"nothing in these runs depends on {', '.join(n for n, d in zip(names, dead, strict=True) if d)}",
                "fly a manoeuvre that moves these degrees of freedom, or omit the terms",
            )
        )
    alive = np.flatnonzero(~dead)
    if len(alive) < 2:
        return doubts
    scale = np.sqrt(np.diag(information)[alive])
    R = information[np.ix_(alive, alive)] / np.outer(scale, scale)
    values, vectors = np.linalg.eigh(R)
    factors = inflation_factors(information[np.ix_(alive, alive)])
    reported: set[int] = set()
    for value, vector in zip(values, vectors.T, strict=True):
        together = [int(i) for i in np.flatnonzero(np.abs(vector) > SHARE) if factors[i] > TOO_MUCH]
        if value > 0.05 or len(together) < 2 or reported & set(together):
            continue
        reported |= set(together)
        terms = " and ".join(names[int(alive[i])] for i in together)
        largest = max(float(factors[i]) for i in together)
        doubts.append(
            Doubt(
                "collinear",
                f"the terms of {terms} are collinear in these runs (variance inflation {largest:.0f})",
                "also fly other speeds and turn rates, or omit one of the terms",
            )
        )
    return doubts
