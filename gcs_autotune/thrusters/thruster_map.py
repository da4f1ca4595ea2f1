"""The static characteristic of a thruster from command to force, its exact inverse, and candidate structures."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["MapStructure", "ThrusterMap", "all_structures"]

Array = NDArray[np.float64]

Shape = Literal["quadratic", "linear", "quadratic+linear"]
Dead = Literal["none", "symmetric", "free"]

_SHAPES: dict[str, Array] = {
    "quadratic": np.array([[0.0], [1.0]]),
    "linear": np.array([[1.0], [1.0]]),
    "quadratic+linear": np.eye(2),
}
"""Shape -> slopes of one side at its edge and at its end, as a linear function of the shape's own parameters."""


@dataclass(frozen=True, slots=True)
class MapStructure:
    """One candidate structure of a map.

    ``ahead``, ``astern``: whether pulls in this direction were measured. ``neutral``: known command of zero force, or
    None. The parameters of the fit are c slopes, k edges and the offset of the dynamometer, in this order. The slopes
    are those of the force at the edge of the dead zone and at the end of the range. In a map with slopes of 0 or more,
    the force therefore rises with the command.
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
        """Description of the structure, such as ``quadratic, sides differ, dead zone free``."""
        sides = "" if not (self.ahead and self.astern) else (", sides alike" if self.same_sides else ", sides differ")
        dead = {"none": "no dead zone", "symmetric": "dead zone symmetric", "free": "dead zone free"}[self.dead]
        return f"{self.shape}{sides}, {dead}" + (", offset" if self.offset else "")

    @property
    def slopes(self) -> Array:
        """Matrix (4, c) from the slope parameters to four slopes: ahead at edge and end, astern at edge and end."""
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
        """Matrix (2, k) from the edge parameters to ``x_f`` and ``x_b``.

        The edge parameters are the middle (if free), then the half-width (if there is a dead zone, never < 0). They are
        added to ``neutral``, or to 0 if ``neutral`` is unknown.
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
        """Number of parameters of the fit."""
        return int(self.slopes.shape[1] + self.edges.shape[1]) + int(self.offset)


def all_structures(ahead: bool, astern: bool, neutral: float | None) -> tuple[MapStructure, ...]:
    """Return every structure that can be distinguished by pulls in the directions *ahead* and *astern*."""
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


SCHEMA = 1


@dataclass(frozen=True, slots=True)
class ThrusterMap:
    """Force map of Miskovic2010, eq. (2.8) with a dead zone, for each direction.

    Let ``x = direction * n``, and let ``s`` be the distance from the edge of the dead zone. For ``s = x - x_f > 0`` the
    force is ``T = a_f s^2 + b_f s``. For ``s = x_b - x > 0`` it is ``T = -(a_b s^2 + b_b s)``. Between the two edges it
    is 0. A ``direction`` of -1 means that a higher command pulls astern.

    - ``low``, ``high``: smallest and largest command tested, which are the ends of the map.
    - ``unit``: unit of the command (``a`` in N/unit^2, ``b`` in N/unit). Outside the dead zone the force rises strictly
      with ``x``.
    """

    a_f: float
    b_f: float
    a_b: float
    b_b: float
    x_f: float
    x_b: float
    low: float
    high: float
    unit: str = "1"
    direction: int = 1

    @property
    def dead_zone(self) -> tuple[float, float]:
        """Commands between which the force is zero, the lower one first."""
        first, second = sorted((self.direction * self.x_b, self.direction * self.x_f))
        return first, second

    @property
    def neutral(self) -> float:
        """Command in the middle of the dead zone."""
        return 0.5 * self.direction * (self.x_f + self.x_b)

    @property
    def limits(self) -> tuple[float, float]:
        """Weakest (most astern) and strongest (most ahead) force within the tested commands [N]."""
        ends = self.force(np.array([self.low, self.high]))
        return float(ends.min()), float(ends.max())

    def force(self, command: ArrayLike) -> Array:
        """Return the force [N] for *command* (any shape).

        Commands outside the tested range produce the force at its end.
        """
        x = self.direction * np.clip(np.asarray(command, dtype=np.float64), self.low, self.high)
        ahead, astern = np.maximum(x - self.x_f, 0.0), np.maximum(self.x_b - x, 0.0)
        result: Array = (self.a_f * ahead + self.b_f) * ahead - (self.a_b * astern + self.b_b) * astern
        return result

    def inverse(self, force: ArrayLike) -> Array:
        """Return the command that produces *force* [N] (any shape), which is the compensation of Miskovic2010, 3.1.

        For zero force the result is ``neutral``. For the smallest force it is the edge of the dead zone. For a force
        outside the range it is the nearest end.
        """
        f = np.asarray(force, dtype=np.float64)
        ahead = self.x_f + _root(self.a_f, self.b_f, np.maximum(f, 0.0))
        astern = self.x_b - _root(self.a_b, self.b_b, np.maximum(-f, 0.0))
        x = np.where(f > 0.0, ahead, np.where(f < 0.0, astern, self.direction * self.neutral))
        result: Array = np.clip(self.direction * x, self.low, self.high)
        return result

    def to_dict(self) -> dict[str, Any]:
        """Return the map as data for JSON."""
        return {"schema": SCHEMA, "model": "thruster", **asdict(self)}

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> ThrusterMap:
        """Return the map that :meth:`to_dict` wrote as *data*."""
        return cls(**{k: v for k, v in data.items() if k not in ("schema", "model")})


def _root(a: float, b: float, f: Array) -> Array:
    """Solve ``a s^2 + b s = f`` for ``s >= 0`` without cancellation; infinite if there is no solution."""
    inside = b * b + 4.0 * a * f
    with np.errstate(divide="ignore", invalid="ignore"):
        bottom = b + np.sqrt(inside)
        s: Array = np.where(f == 0.0, 0.0, np.where((inside >= 0.0) & (bottom > 0.0), 2.0 * f / bottom, math.inf))
    return s
