"""What is hidden in a case: effects with places and numbers, and what the flying has to take care of."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

from benchmarks.blind.craft import Craft

__all__ = ["Hidden", "Recipe"]


@dataclass(frozen=True)
class Hidden:
    """One effect to hide.

    ``craft``: what carries it. ``turns``: the heading has to go round.
    ``start``: signal -> (mean, spread) of where runs begin. ``in_runs``: the runs that have it, None: all.
    ``plain``: how the base model drags, ``linear`` or ``none`` (then neither does the bare hull).
    ``near_bottom``: runs reach down to the bottom. ``near_wall``: runs reach to the ``distance`` of the origin from
    the wall.
    """

    slug: str
    place: str
    values: Mapping[str, float]
    craft: Craft
    turns: bool = False
    start: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    in_runs: tuple[int, ...] | None = None
    plain: str = "linear"
    near_bottom: bool = False
    near_wall: bool = False


@dataclass(frozen=True)
class Recipe:
    """How an effect is drawn: on which kinds of craft, and its place and numbers.

    ``coarse``: it comes in one size only (a sign, a swap, a unit), so that its weight cannot be chosen by its size.
    """

    kinds: tuple[str, ...]
    draw: Callable[[np.random.Generator, Craft], Hidden]
    coarse: bool = False
