"""The static characteristic of a thruster: command to force and its exact inverse, with candidate structures."""

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

    ``ahead``/``astern``: which sides were tested. ``neutral``: known command of zero force, or None. The parameters of
    the fit are slopes ``c``, then edges ``k``, then the offset of the dynamometer. The slopes are those of the force at
    the edge of the dead zone and at the end of the range. A map with ``c >= 0`` therefore rises.
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
        """Description, e.g. ``quadratic, sides differ, dead zone free``."""
        sides = "" if not (self.ahead and self.astern) else (", sides alike" if self.same_sides else ", sides differ")
        dead = {"none": "no dead zone", "symmetric": "dead zone symmetric", "free": "dead zone free"}[self.dead]
        return f"{self.shape}{sides}, {dead}" + (", offset" if self.offset else "")

    @property
    def slopes(self) -> Array:
        """Matrix (4, c) from slope parameters to slopes: ahead at edge and end, astern at edge and end."""
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
        """Matrix (2, k) from edge parameters to ``x_f`` and ``x_b``.

        The edge parameters are the middle (if free), then the half-width (if there is a dead zone, never < 0). They are
        added to ``neutral``, or to 0 if that is unknown.
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
    """Return every structure that pulls in these directions can distinguish."""
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

    Let ``x = direction * n``, and let ``s`` be the distance from the edge of the dead zone. Then ``T = a_f s^2 + b_f
    s`` for ``s = x - x_f > 0``, ``T = -(a_b s^2 + b_b s)`` for ``s = x_b - x > 0``, and 0 between. ``direction`` -1: a
    higher command pulls astern.

    - ``low``, ``high``: limits of the commands tested, which are the ends of the map.
    - ``unit``: that of the command (``a`` in N/unit^2, ``b`` in N/unit). The map rises strictly outside the dead zone.
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
        """The commands between which the force is zero, lower first."""
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
        """Return the force [N] of *command* (any shape); commands outside the tested range give the force at its
        end."""
        x = self.direction * np.clip(np.asarray(command, dtype=np.float64), self.low, self.high)
        ahead, astern = np.maximum(x - self.x_f, 0.0), np.maximum(self.x_b - x, 0.0)
        result: Array = (self.a_f * ahead + self.b_f) * ahead - (self.a_b * astern + self.b_b) * astern
        return result

    def inverse(self, force: ArrayLike) -> Array:
        """Return the command that gives *force* [N] (any shape): the compensation of Miskovic2010, 3.1.

        Zero force gives ``neutral``. The smallest force gives the edge of the dead zone. A force outside the range
        gives the nearest end.
        """
        f = np.asarray(force, dtype=np.float64)
        ahead = self.x_f + _root(self.a_f, self.b_f, np.maximum(f, 0.0))
        astern = self.x_b - _root(self.a_b, self.b_b, np.maximum(-f, 0.0))
        x = np.where(f > 0.0, ahead, np.where(f < 0.0, astern, self.direction * self.neutral))
        result: Array = np.clip(self.direction * x, self.low, self.high)
        return result

    def to_dict(self) -> dict[str, Any]:
        """Return the map as plain data for a file."""
        return {"schema": SCHEMA, "model": "thruster", **asdict(self)}

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> ThrusterMap:
        """Rebuild a map from the data of :meth:`to_dict`."""
        return cls(**{k: v for k, v in data.items() if k not in ("schema", "model")})


def _root(a: float, b: float, f: Array) -> Array:
    """Solve ``a s^2 + b s = f`` for ``s >= 0`` without cancellation; infinite if there is no solution."""
    inside = b * b + 4.0 * a * f
    with np.errstate(divide="ignore", invalid="ignore"):
        bottom = b + np.sqrt(inside)
        s: Array = np.where(f == 0.0, 0.0, np.where((inside >= 0.0) & (bottom > 0.0), 2.0 * f / bottom, math.inf))
    return s
