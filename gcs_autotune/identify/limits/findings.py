"""What :mod:`.identifiability` finds, as plain facts that :mod:`.words` puts into sentences."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

__all__ = ["Direction", "Unseen"]


@dataclass(frozen=True, slots=True)
class Direction:
    """A joint change of parameters that runs do not see, or hardly.

    ``derivatives``: the members' SNAME names. ``changes`` relative to each value (0.4: 40 % larger in magnitude): for a
    practical direction what stays within 95 % of the noise, for an ``exact`` one only the ratios mean anything.
    ``scaling``: all by the same factor.
    """

    members: tuple[str, ...]
    derivatives: tuple[str, ...]
    changes: Mapping[str, float]
    exact: bool
    scaling: bool


@dataclass(frozen=True, slots=True)
class Unseen:
    """A parameter whose standard error exceeds its value.

    ``derivative`` its SNAME name; ``slight``: even so its force stays below what would be felt in the motion seen.
    """

    name: str
    derivative: str
    value: float
    std: float
    unit: str
    slight: bool
