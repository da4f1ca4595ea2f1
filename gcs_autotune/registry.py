"""Looking a name up in one of our tables, with help for typing errors."""

from __future__ import annotations

import difflib
from collections.abc import Mapping
from typing import TypeVar

from gcs_autotune.errors import UnknownName

__all__ = ["lookup"]

T = TypeVar("T")


def lookup(table: Mapping[str, T], name: str, kind: str) -> T:
    """Return ``table[name]``.

    Raises
    ------
    UnknownName
        When *name* is not in *table*; the message lists what there is and the nearest spellings.
    """
    try:
        return table[name]
    except KeyError:
        nearest = difflib.get_close_matches(name, list(table), n=3, cutoff=0.5)
        hint = f" Did you mean {' or '.join(nearest)}?" if nearest else ""
        known = ", ".join(table)
        raise UnknownName(f"unknown {kind} '{name}'.{hint} Known: {known}.", name=name, nearest=nearest) from None
