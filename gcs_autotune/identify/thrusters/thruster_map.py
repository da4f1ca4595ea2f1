"""The static characteristic of a thruster: command to force, and exactly back."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["ThrusterMap"]

Array = NDArray[np.float64]

SCHEMA = 1


@dataclass(frozen=True, slots=True)
class ThrusterMap:
    """Miskovic2010, eq. (2.8) behind a dead zone, per direction.

    With ``x = direction * n`` and ``s`` the distance from the edge of the dead zone,
    ``T = a_f s^2 + b_f s`` for ``s = x - x_f > 0``, ``T = -(a_b s^2 + b_b s)`` for ``s = x_b - x > 0``, 0 between.

    ``direction`` -1: a higher command pulls back. ``low``, ``high``: commands tested, ends of the map; ``unit`` that of
    the command (``a`` in N/unit^2, ``b`` in N/unit). The map rises strictly outside the dead zone.
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
        """Commands between which nothing pulls, lower first."""
        first, second = sorted((self.direction * self.x_b, self.direction * self.x_f))
        return first, second

    @property
    def neutral(self) -> float:
        """Command in the middle of the dead zone."""
        return 0.5 * self.direction * (self.x_f + self.x_b)

    @property
    def limits(self) -> tuple[float, float]:
        """Weakest (most astern) and strongest (most ahead) force of the commands tested [N]."""
        ends = self.force(np.array([self.low, self.high]))
        return float(ends.min()), float(ends.max())

    def force(self, command: ArrayLike) -> Array:
        """Return the force [N] of *command* (any shape); commands outside those tested give the ends' force."""
        x = self.direction * np.clip(np.asarray(command, dtype=np.float64), self.low, self.high)
        ahead, astern = np.maximum(x - self.x_f, 0.0), np.maximum(self.x_b - x, 0.0)
        result: Array = (self.a_f * ahead + self.b_f) * ahead - (self.a_b * astern + self.b_b) * astern
        return result

    def inverse(self, force: ArrayLike) -> Array:
        """Return the command that gives *force* [N] (any shape): the compensation of Miskovic2010, 3.1.

        No force gives ``neutral``, the smallest force the edge of the dead zone, a force out of reach the nearest end.
        """
        f = np.asarray(force, dtype=np.float64)
        ahead = self.x_f + _root(self.a_f, self.b_f, np.maximum(f, 0.0))
        astern = self.x_b - _root(self.a_b, self.b_b, np.maximum(-f, 0.0))
        x = np.where(f > 0.0, ahead, np.where(f < 0.0, astern, self.direction * self.neutral))
        result: Array = np.clip(self.direction * x, self.low, self.high)
        return result

    def to_dict(self) -> dict[str, Any]:
        """Return plain data for a file."""
        return {"schema": SCHEMA, "model": "thruster", **asdict(self)}

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> ThrusterMap:
        """Rebuild from :meth:`to_dict`."""
        return cls(**{k: v for k, v in data.items() if k not in ("schema", "model")})


def _root(a: float, b: float, f: Array) -> Array:
    """Solve ``a s^2 + b s = f`` for ``s >= 0`` without cancellation; infinite where there is none."""
    inside = b * b + 4.0 * a * f
    with np.errstate(divide="ignore", invalid="ignore"):
        bottom = b + np.sqrt(inside)
        s: Array = np.where(f == 0.0, 0.0, np.where((inside >= 0.0) & (bottom > 0.0), 2.0 * f / bottom, math.inf))
    return s
