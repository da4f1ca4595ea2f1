"""A published table: rows of published and our numbers, and its goal."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

__all__ = ["Compute", "Row", "Section", "rows_of"]

Compute = Callable[[Mapping[str, Any]], Sequence["Section"]]
"""Function of a section: the whole JSON -> one or more tables."""


@dataclass(frozen=True, slots=True)
class Row:
    """One number, in the unit of the printed table. ``counts``: it is part of the verdict."""

    name: str
    published: float
    ours: float
    counts: bool = True

    @property
    def difference(self) -> float:
        """Ours against the published one [%]; from 0 in parts of one hundred of the unit itself."""
        if self.published == 0.0:
            return 100.0 * self.ours
        return 100.0 * (self.ours / self.published - 1.0)


@dataclass(frozen=True, slots=True)
class Section:
    """A published table compared with ours.

    ``basis`` states where our values come from; ``goal`` is the largest difference allowed [%], infinite if the
    table is only compared; ``exact``: rows must be equal; ``below``: ours is an error that must not exceed the
    published one.
    """

    title: str
    basis: str
    rows: tuple[Row, ...]
    goal: float = math.inf
    exact: bool = False
    below: bool = False

    @property
    def worst(self) -> Row:
        """Return the counted row with the largest difference (of errors: the one least below)."""
        counted = [r for r in self.rows if r.counts]
        return max(counted, key=lambda r: r.difference if self.below else abs(r.difference))

    @property
    def met(self) -> bool:
        """Return whether every counted row reaches the goal."""
        if not all(math.isfinite(r.ours) for r in self.rows if r.counts):
            return False
        if self.exact:
            return all(r.ours == r.published for r in self.rows if r.counts)
        if self.below:
            return self.worst.ours <= self.worst.published
        return abs(self.worst.difference) <= self.goal


def rows_of(label: str, names: Sequence[str], published: Sequence[float], ours: Sequence[float]) -> list[Row]:
    """Return one row per name, each called ``label name``."""
    return [Row(f"{label} {n}", float(p), float(o)) for n, p, o in zip(names, published, ours, strict=True)]
