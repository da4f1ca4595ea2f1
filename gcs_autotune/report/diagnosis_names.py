"""What effects, channels and values of a diagnosis are called among people."""

from __future__ import annotations

from gcs_autotune.diagnose.result import Cause, Value
from gcs_autotune.report.numbers import UNKNOWN, format_value, pretty_unit, to_people
from gcs_autotune.sname import DOFS, SIGNALS

__all__ = ["effect_words", "named", "place_words", "signal_words", "value_words"]


def effect_words(slug: str) -> str:
    """Return a slug as people say it: ``dead-zone`` is ``dead zone``."""
    return slug.replace("-", " ")


def signal_words(signal: str) -> str:
    """Return what a channel is called: ``psi`` is ``heading``; unknown ones keep their name."""
    return SIGNALS[signal][1].split(",")[0] if signal in SIGNALS else signal


def place_words(place: str) -> str:
    """Return where an effect sits: ``N`` is ``yaw moment (N)``, ``yaw`` stays, ``t`` is the file's clock."""
    return " and ".join(_place(part) for part in place.split("+"))


def _place(part: str) -> str:
    if part == "t":
        return "the file's clock"
    return f"{signal_words(part)} ({part})" if part in SIGNALS else part


def named(cause: Cause) -> str:
    """Return an effect with its place: ``dead zone on yaw moment (N)``, ``input bias in yaw``."""
    place = cause.applied.place
    preposition = "in" if place.split("+")[0] in DOFS else "on"
    return f"{effect_words(cause.applied.slug)} {preposition} {place_words(place)}"


def value_words(value: Value) -> str:
    """Return a number with its standard error, in degrees where people use them."""
    unit, factor = to_people(value.unit)
    number = format_value(factor * value.value, factor * value.std)
    shown = pretty_unit(unit)
    if not shown or number == UNKNOWN:
        return number
    return f"{number}{shown}" if shown.startswith("°") else f"{number} {shown}"
