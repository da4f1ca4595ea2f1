"""What effects, channels and values of a diagnosis are called among people."""

from __future__ import annotations

import math
from collections.abc import Sequence

from gcs_autotune.diagnose import Cause, Value
from gcs_autotune.report.numbers import NOT_TOLD, UNKNOWN, format_parameter, pretty_unit, rounded_to, to_people
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
    place, effect = cause.effect.place, effect_words(cause.effect.slug)
    first = place.split("+")[0]
    if first not in DOFS and first not in SIGNALS and first != "t":
        return f"{effect} ({place})"
    return f"{effect} {'in' if first in DOFS else 'on'} {place_words(place)}"


def value_words(value: Value, name: str = "") -> str:
    """Return a number with its standard error in the unit it is set in, angles in degrees besides.

    name : of the parameter: an ``anchor`` or a ``direction`` in radians is a heading.
    """
    number = format_parameter(name, value.value, value.std, value.unit)
    shown = pretty_unit(value.unit)
    if not shown or number in (UNKNOWN, NOT_TOLD):
        return number
    unit, factor = to_people(value.unit)
    angle = value.value % (2.0 * math.pi) if name in ("anchor", "direction") else value.value
    degrees = f" ({rounded_to(factor * angle, factor * value.std)}{unit})" if unit.startswith("°") else ""
    return f"{number} {shown}{degrees}"
