"""What effects, channels and values of a diagnosis are called among people."""

from __future__ import annotations

from collections.abc import Sequence

from gcs_autotune.diagnose.result import Cause, Value
from gcs_autotune.report.numbers import UNKNOWN, format_value, pretty_unit, to_people
from gcs_autotune.sname import DOFS, SIGNALS

__all__ = ["effect_words", "listed", "named", "place_words", "signal_words", "value_words"]

MOST_PLACES = 3
"""Columns named one by one in a sentence."""


def effect_words(slug: str) -> str:
    """Return a slug as people say it: ``dead-zone`` is ``dead zone``."""
    return slug.replace("-", " ")


def signal_words(signal: str) -> str:
    """Return what a channel is called: ``psi`` is ``heading``; unknown ones keep their name."""
    return SIGNALS[signal][1].split(",")[0] if signal in SIGNALS else signal


def place_words(place: str) -> str:
    """Return where an effect sits: ``N`` is ``yaw moment (N)``, ``yaw`` stays, ``t`` is the file's clock."""
    parts = place.split("+")
    if len(parts) > MOST_PLACES:
        return f"{len(parts)} columns ({', '.join(parts)})"
    return listed([_place(part) for part in parts])


def _place(part: str) -> str:
    if part == "t":
        return "the file's clock"
    return f"{signal_words(part)} ({part})" if part in SIGNALS else part


def listed(names: Sequence[str]) -> str:
    """Return ``a, b and c``."""
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"


def named(cause: Cause) -> str:
    """Return an effect with its place: ``dead zone on yaw moment (N)``, ``input bias in yaw``."""
    place, effect = cause.applied.place, effect_words(cause.applied.slug)
    first = place.split("+")[0]
    if first not in DOFS and first not in SIGNALS and first != "t":
        return f"{effect} ({place})"
    return f"{effect} {'in' if first in DOFS else 'on'} {place_words(place)}"


def value_words(value: Value) -> str:
    """Return a number with its standard error, in degrees where people use them."""
    unit, factor = to_people(value.unit)
    number = format_value(factor * value.value, factor * value.std)
    shown = pretty_unit(unit)
    if not shown or number == UNKNOWN:
        return number
    return f"{number}{shown}" if shown.startswith("°") else f"{number} {shown}"
