"""Define a doubt: a reason not to trust a result."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

__all__ = ["Doubt", "once"]


@dataclass(frozen=True, slots=True)
class Doubt:
    """A reason not to trust a result.

    - ``slug``: its short name.
    - ``cause``: its probable cause.
    - ``cure``: the remedy.
    """

    slug: str
    cause: str
    cure: str


def once(doubts: Iterable[Doubt]) -> tuple[Doubt, ...]:
    """Return *doubts* in their order, without repeats of the same slug and cause."""
    return tuple({(d.slug, d.cause): d for d in doubts}.values())
