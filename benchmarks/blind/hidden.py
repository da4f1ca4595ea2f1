"""Hidden effects of a case, with their places and parameters and what the runs need to show them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

from benchmarks.blind.craft import Craft

__all__ = ["Hidden", "Recipe"]


@dataclass(frozen=True)
class Hidden:
    """One effect to hide.

    ``craft``: the craft that has it. ``turns``: the heading must make full turns.
    ``start``: signal -> (mean, standard deviation) of its initial value. ``in_runs``: the runs that have it; None: all.
    ``plain``: drag of the base model and of the bare hull, ``linear`` or ``none``.
    ``near_bottom``: runs come close to the bottom.
    ``near_wall``: runs come as close to the wall as its ``distance`` from the origin.
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
    """How an effect is drawn: the kinds of craft, and its place and parameters.

    ``coarse``: it has one size only (a sign, a swap, a unit). The ratio of its error to the noise cannot be chosen.
    """

    kinds: tuple[str, ...]
    draw: Callable[[np.random.Generator, Craft], Hidden]
    coarse: bool = False
