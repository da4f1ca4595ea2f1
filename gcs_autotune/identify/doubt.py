"""A reason not to trust a result."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["Doubt"]


@dataclass(frozen=True, slots=True)
class Doubt:
    """A reason not to trust a result, with its possible cause and the remedy."""

    slug: str
    cause: str
    cure: str
