"""Local polynomials (Savitzky1964) for uneven time stamps. Their width is chosen by prediction of left-out samples."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["LocalPolynomials", "best_width", "local_polynomials"]

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class LocalPolynomials:
    """Polynomials about several times.

    Attributes
    ----------
    coefficients : (s, degree + 1) coefficients of powers of the time since each [s].
    own_weight : (s,) weight of a sample at that time in its own fitted value.
    """

    coefficients: Array
    own_weight: Array

    def derivative(self, order: int) -> Array:
        """Return the derivative (s,) of that *order* at the times. Order 0 is the value."""
        result: Array = math.factorial(order) * self.coefficients[:, order]
        return result


def local_polynomials(t: Array, values: Array, at: Array, width: int, degree: int) -> LocalPolynomials:
    """Fit a polynomial of *degree* through the *width* samples nearest to each time.

    The degree is lower if *width* is too small for it. t, values : (n,), t ascending, n >= width. at : (s,) times.
    """
    n = len(t)
    nearest = np.searchsorted(0.5 * (t[1:] + t[:-1]), at)
    index = np.clip(nearest - width // 2, 0, n - width)[:, None] + np.arange(width)
    span = t[index[:, -1]] - t[index[:, 0]]
    z = (t[index] - at[:, None]) / span[:, None]
    degree = min(degree, width - 1)
    V = z[:, :, None] ** np.arange(degree + 1)
    turned = V.transpose(0, 2, 1)
    inverse = np.linalg.inv(turned @ V + 1e-12 * np.eye(degree + 1))
    c = (inverse @ (turned @ values[index][:, :, None]))[:, :, 0] / span[:, None] ** np.arange(degree + 1)
    return LocalPolynomials(c, inverse[:, 0, 0])


def best_width(t: Array, values: Array, widths: Iterable[int], degree: int) -> tuple[int, float]:
    """Return which of the *widths* best predicts samples left out, and the noise of a sample.

    The noise is the standard deviation of the residual for that width.
    """
    best: tuple[float, int, float] | None = None
    for width in widths:
        found = local_polynomials(t, values, t, width, degree)
        residual = values - found.coefficients[:, 0]
        rest = np.maximum(1.0 - found.own_weight, 1e-6)
        missed = float(np.mean((residual / rest) ** 2))
        if best is None or missed < best[0]:
            noise = math.sqrt(float(residual @ residual) / max(float(rest.sum()), 1e-9))
            best = (missed, width, noise)
    if best is None:
        raise ValueError("no width to choose from")
    return best[1], best[2]
