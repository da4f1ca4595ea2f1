"""Points spread evenly over a cube: the start of Sobol's sequence, unscrambled.

Direction numbers after Joe2008, for as many dimensions as a loop has gains. The same numbers as
``scipy.stats.qmc.Sobol`` to the last bit, without a second of importing ``scipy.stats``.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["DIMENSIONS", "sobol"]

_POLYNOMIALS: tuple[tuple[int, int, tuple[int, ...]], ...] = (
    (1, 0, (1,)),
    (2, 1, (1, 3)),
    (3, 1, (1, 3, 1)),
    (3, 2, (1, 1, 1)),
    (4, 1, (1, 1, 3, 3)),
    (4, 4, (1, 3, 5, 13)),
    (5, 2, (1, 1, 5, 5, 17)),
    (5, 4, (1, 1, 5, 5, 5)),
    (5, 7, (1, 1, 7, 11, 19)),
)
"""Per dimension after the first: degree of the primitive polynomial, its inner coefficients as bits, first numbers."""

DIMENSIONS = len(_POLYNOMIALS) + 1


def sobol(dimensions: int, power: int) -> NDArray[np.float64]:
    """Return the first ``2**power`` points, (2**power, dimensions), each in [0, 1).

    Raises
    ------
    ValueError
        More than :data:`DIMENSIONS`.
    """
    if dimensions > DIMENSIONS:
        raise ValueError(f"{dimensions} dimensions, at most {DIMENSIONS} are tabled")
    directions = np.array([_directions(d, power) for d in range(dimensions)], dtype=np.int64)
    points, at = np.zeros((2**power, dimensions)), np.zeros(dimensions, dtype=np.int64)
    for k in range(1, 2**power):
        lowest_zero = ((k - 1) ^ k).bit_length() - 1  # of k - 1: the bit the Gray code changes
        at ^= directions[:, lowest_zero]
        points[k] = at / 2.0**power
    return points


def _directions(dimension: int, power: int) -> list[int]:
    """Return the direction numbers of one dimension (0 the first), scaled to integers of *power* bits."""
    if dimension == 0:
        return [1 << (power - 1 - i) for i in range(power)]
    degree, inner, first = _POLYNOMIALS[dimension - 1]
    m = list(first)
    while len(m) < power:
        i = len(m)
        new = m[i - degree] ^ (m[i - degree] << degree)
        for k in range(1, degree):
            new ^= ((inner >> (degree - 1 - k)) & 1) * (m[i - k] << k)
        m.append(new)
    return [m[i] << (power - 1 - i) for i in range(power)]
