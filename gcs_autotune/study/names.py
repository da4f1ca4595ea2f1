"""Words for the names of a study: its values and results. Names of the user's own are quoted as they were typed."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from gcs_autotune.effects import EFFECTS, effect_words
from gcs_autotune.limits import axes_of
from gcs_autotune.study.jobs import JOBS

__all__ = ["words_of"]

_WORDS: Mapping[str, str] = {
    "effect": "effect",
    "seed": "seed of the noise",
    "vehicle.like": "simulated vehicle",
    "vehicle.scale": "length of the craft, relative to the vehicle",
}
_RESULTS: Mapping[str, str] = {
    "kept": "new gains kept",
    "residual_rms": "rms residual [SI]",
    "causes.0": "first reported cause",
}
"""Results of commands of this program, and what they are."""
_METRICS: Mapping[str, str] = {
    "itae": "tracking error (ITAE per unit step) [s²]",
    "overshoot": "overshoot [fraction of the step]",
    "rise": "rise time [s]",
    "settling": "settling time [s]",
    "steady_error": "remaining error [fraction of the step]",
    "travel": "actuator travel [full output/s]",
}
"""Fields of the metrics of a step that a tune reports as ``metrics.before`` and ``metrics.after``."""


def words_of(name: str, do: str, vehicle_unit: Callable[[str], str]) -> str:
    """Return the words for the *name* of a value or result of a study that does *do*, with its unit if it is known.

    A name that the user chose, or that is only defined in a vehicle file, is quoted. *vehicle_unit* : returns the unit
    of a number in the vehicle file.
    """
    if name in _WORDS:
        return _WORDS[name]
    first, _, rest = name.partition(".")
    if first == "argument":
        return f"argument '{rest}'"
    if first == "vehicle":
        number = rest.removesuffix(".times")
        if number != rest:
            return f"factor on '{number}' of the vehicle file"
        return f"'{number}' of the vehicle file" + _bracketed(vehicle_unit(number))
    if first == "effect":
        return _of_effect(rest)
    if do in JOBS and first in JOBS[do].steps:
        return _of_option(rest)
    return _of_result(name) if do in JOBS else f"result '{name}'"


def _of_effect(name: str) -> str:
    slug, _, quantity = name.rpartition(".")
    slug, _, place = slug.partition("@")
    entry = EFFECTS.get(slug)
    unit = next((q.unit for q in entry.parameters if q.name == quantity), "") if entry is not None else ""
    where = f" ({place})" if place else ""
    return f"{effect_words(slug)}{where}: {quantity}" + _bracketed(unit)


def _of_option(name: str) -> str:
    units = {limit.unit for limit in axes_of(name)}
    unit = units.pop() if len(units) == 1 else ""  # it may differ by axis
    return name.replace("-", " ") + _bracketed(unit)


def _bracketed(unit: str) -> str:
    return f" [{unit}]".replace("^2", "²").replace("^3", "³") if unit else ""


def _of_result(name: str) -> str:
    group, _, field = name.rpartition(".")
    if field in _METRICS and group in ("metrics.before", "metrics.after"):
        return f"{_METRICS[field]}, {group.partition('.')[2]} the tune"
    return _RESULTS.get(name, f"result '{name}'")
