"""Look up a name in a table or among the entry points of other packages, with suggestions for typing errors."""

from __future__ import annotations

import difflib
from collections.abc import Mapping, Sequence
from typing import Any, TypeVar

from gcs_autotune.errors import UnknownName, UsageError

__all__ = ["lookup", "nearest_of", "same_name"]

T = TypeVar("T")


def lookup(table: Mapping[str, T], name: str, kind: str, *, group: str = "") -> T:
    """Return ``table[name]``, or the object that another package provides under that name.

    Parameters
    ----------
    kind : text for the type of object, for the message.
    group : entry points (``[project.entry-points."gcs_autotune.transports"]`` in that package's pyproject.toml) that
        are searched only if the table has no such name.

    Raises
    ------
    UnknownName
        *name* does not exist; the message lists the existing and the nearest names.
    UsageError
        A package provides it but cannot be loaded.
    """
    if name in table:
        return table[name]
    offered = _offered(group) if group else {}
    if name in offered:
        loaded: T = _loaded(offered[name], kind)
        return loaded
    known = [*table, *offered]
    nearest, hint = nearest_of(name, known)
    raise UnknownName(f"unknown {kind} '{name}'.{hint} Known: {', '.join(known)}.", name=name, nearest=nearest)


def same_name(one: object, other: object) -> bool:
    """Return whether two names differ only in capitals, hyphens, underscores and spaces: ``zig-zag``, ``Zig_Zag``."""
    return _letters(one) == _letters(other)


def _letters(name: object) -> str:
    return "".join(c for c in str(name).casefold() if c not in "-_ ")


def nearest_of(name: str, known: Sequence[str]) -> tuple[list[str], str]:
    """Return the *known* names nearest to *name*, and the question whether one was meant; empty without any."""
    nearest = difflib.get_close_matches(name, known, n=3, cutoff=0.5)
    return nearest, f" Did you mean {' or '.join(nearest)}?" if nearest else ""


def _offered(group: str) -> dict[str, Any]:
    from importlib.metadata import entry_points  # seldom needed, and slow to import

    return {point.name: point for point in entry_points(group=group)}


def _loaded(point: Any, kind: str) -> Any:
    try:
        return point.load()
    except (ImportError, AttributeError) as error:
        raise UsageError(f"the {kind} '{point.name}' ({point.value}) cannot be loaded: {error}") from error
