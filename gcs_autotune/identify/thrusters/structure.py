"""Which thruster maps there are to choose from: shape, sides, dead zone, offset."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

__all__ = ["MapStructure", "all_structures"]

Array = NDArray[np.float64]

Shape = Literal["quadratic", "linear", "quadratic+linear"]
Dead = Literal["none", "symmetric", "free"]

_SHAPES: dict[str, Array] = {
    "quadratic": np.array([[0.0], [1.0]]),
    "linear": np.array([[1.0], [1.0]]),
    "quadratic+linear": np.eye(2),
}
"""How the slopes of one side at its edge and at its end follow from the shape's own parameters."""


@dataclass(frozen=True, slots=True)
class MapStructure:
    """One candidate. ``ahead``/``astern``: which sides were tested; ``neutral``: known command of no force, or None.

    The fit's parameters are slopes ``c`` (the force's slope at the edge of the dead zone and at the end of the range,
    so that ``c >= 0`` means a map that rises), then edges ``k``, then the offset of the dynamometer.
    """

    shape: Shape
    same_sides: bool
    dead: Dead
    offset: bool
    ahead: bool = True
    astern: bool = True
    neutral: float | None = 0.0

    @property
    def name(self) -> str:
        """In words, e.g. ``quadratic, sides differ, dead zone free``."""
        sides = "" if not (self.ahead and self.astern) else (", sides alike" if self.same_sides else ", sides differ")
        dead = {"none": "no dead zone", "symmetric": "dead zone symmetric", "free": "dead zone free"}[self.dead]
        return f"{self.shape}{sides}, {dead}" + (", offset" if self.offset else "")

    @property
    def slopes(self) -> Array:
        """(4, c): slopes ahead at edge and end, astern at edge and end, by the slope parameters."""
        one = _SHAPES[self.shape]
        if self.same_sides:
            return np.vstack([one, one])
        sides = [one * float(self.ahead), one * float(self.astern)]
        c = one.shape[1]
        full = np.zeros((4, 2 * c))
        full[:2, :c], full[2:, c:] = sides[0], sides[1]
        return full[:, np.any(full != 0.0, axis=0)]

    @property
    def edges(self) -> Array:
        """(2, k): ``x_f`` and ``x_b`` by the edge parameters: middle (if free), then half-width (if any, never < 0).

        They are added to ``neutral``, or to 0 when that is unknown.
        """
        if self.dead == "symmetric":
            return np.array([[1.0], [-1.0]])
        if self.dead == "free":
            if self.ahead and self.astern:
                return np.array([[1.0, 1.0], [1.0, -1.0]])
            return np.array([[1.0], [0.0]]) if self.ahead else np.array([[0.0], [-1.0]])
        return np.ones((2, 1)) if self.neutral is None else np.zeros((2, 0))

    @property
    def count(self) -> int:
        """Number of parameters."""
        return int(self.slopes.shape[1] + self.edges.shape[1]) + int(self.offset)


def all_structures(ahead: bool, astern: bool, neutral: float | None) -> tuple[MapStructure, ...]:
    """Return every structure that pulls in these directions can tell apart."""
    both = ahead and astern
    deads: tuple[Dead, ...] = ("none", "symmetric", "free") if both and neutral is not None else ("none", "free")
    if not both and neutral is None:
        deads = ("none",)
    shapes: tuple[Shape, ...] = ("quadratic", "linear", "quadratic+linear")
    return tuple(
        MapStructure(shape, same, dead, offset, ahead, astern, neutral)
        for shape in shapes
        for same in ((True, False) if both else (False,))
        for dead in deads
        for offset in (False, True)
    )
