"""The report of what a craft can do, and of the limits that ArduPilot should have."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import TYPE_CHECKING

from gcs_autotune.design import Authority, AuthorityFigure, Missing, ParameterLimit
from gcs_autotune.report.toolkit.canvas import AFTER, WANTED, legend, new_axes
from gcs_autotune.report.toolkit.document import (
    IN_RESULT,
    Document,
    Figure,
    Note,
    Part,
    Section,
    Table,
    Verdict,
    bullets,
)
from gcs_autotune.report.toolkit.wording import UNKNOWN, format_number, pretty_unit, to_people
from gcs_autotune.rounding import rounded_to

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Drawing

__all__ = ["authority_document"]

HEADS = ("figure", "value", "95 % interval", "unit")
EXTRAPOLATED = "extrapolated"
"""Text in place of an interval that does not cover the error of the extrapolation."""
SECTION_OF = {
    "turning": ("turn-", "steerage"),
    "holding": ("current", "moment-", "side-force-"),
}
"""Section -> beginnings of the slugs of its figures; all others are of speed and stopping."""


def authority_document(authority: Authority, limits: Sequence[ParameterLimit], when: str = "") -> Document:
    """Return the report of *authority*: figures, circles, *limits*, and what the inputs do not determine."""
    story = authority, limits
    return Document(
        title="What the craft can do",
        when=when,
        verdict=Verdict(_verdict(authority), "neutral"),
        sections=tuple(section for make in SECTIONS for section in make(*story)),
        facts=_facts(authority, limits),
    )


def _verdict(authority: Authority) -> str:
    figures, craft = authority.figures, authority.models
    said = []
    if "cruise-speed" in figures:
        said.append(f"makes {_worded(figures['cruise-speed'])} at {100.0 * craft.working:.0f} % throttle")
    turns = [f for side in ("port", "starboard") if (f := figures.get(f"turn-rate-{side}")) is not None]
    if turns:
        least = min(turns, key=lambda f: f.value)
        said.append(f"turns at {_worded(least)} at full steering{f' ({least.note})' if least.note else ''}")
    how = next((h for h in ("astern", "coasting") if f"stop-{h}" in figures), "")
    if how:
        words = "with full astern" if how == "astern" else "without thrust"
        said.append(f"stops in {_worded(figures[f'stop-{how}'])} {words}")
    if not said:
        return "These models do not determine what the craft can do."
    return f"The craft {', '.join(said[:-1])}{' and ' if said[1:] else ''}{said[-1]}."


def _worded(figure: AuthorityFigure) -> str:
    unit, factor = to_people(figure.unit)
    value, std = factor * figure.value, factor * figure.std
    is_rough = value != 0.0 and std > 10.0 ** (math.floor(math.log10(abs(value))) - 2)
    number = rounded_to(value, std) if is_rough else format_number(value, 3)  # never more digits than in the table
    return f"{number}{'' if unit.startswith('°') else ' '}{pretty_unit(unit)}"


def _facts(authority: Authority, limits: Sequence[ParameterLimit]) -> dict[str, object]:
    """Return plain data, SI; unknown numbers are None."""

    def plain(figure: AuthorityFigure) -> dict[str, object]:
        low, high = figure.interval
        return {
            "value": figure.value,
            "low": _known(low),
            "high": _known(high),
            "extrapolated": figure.extrapolated,
            "unit": figure.unit,
            "note": figure.note,
        }

    return {
        "schema": 1,
        "throttle": authority.models.working,
        "figures": {slug: {"title": f.title, **plain(f)} for slug, f in authority.figures.items()},
        "circles": [
            {
                "throttle": _known(circle.throttle),
                "speed": plain(circle.speed),
                "rates": {side: plain(f) for side, f in circle.rates.items()},
                "diameters": {side: plain(f) for side, f in circle.diameters.items()},
            }
            for circle in authority.circles
        ],
        "limits": [
            {"name": row.name, "present": _known(row.present), "value": row.value, "unit": row.unit, "rule": row.rule}
            for row in limits
        ],
        "missing": [{"what": row.what, "fly": row.fly} for row in authority.missing],
        "assumed": list(authority.assumed),
    }


def _known(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _speeds(authority: Authority, limits: Sequence[ParameterLimit]) -> Iterator[Section]:
    taken = tuple(start for starts in SECTION_OF.values() for start in starts)
    rows = [f for f in authority.figures.values() if not f.slug.startswith(taken)]
    means = "Accelerations are means: from rest to the speed, and from the speed to a tenth of it, where a stop ends."
    yield Section("speed", "Speed and stopping", (*_table(rows), *_noted(means, bool(rows))), facts=IN_RESULT)


def _turning(authority: Authority, limits: Sequence[ParameterLimit]) -> Iterator[Section]:
    rows = [f for f in authority.figures.values() if f.slug.startswith(SECTION_OF["turning"])]
    circles = [
        (
            "" if math.isnan(c.throttle) else f"{100.0 * c.throttle:.3g} %",
            _short(c.speed),
            *(_short(c.rates[side]) for side in ("port", "starboard")),
            *(_short(c.diameters[side]) for side in ("port", "starboard")),
        )
        for c in authority.circles
    ]
    heads = ("throttle", "speed [m/s]", "port [°/s]", "starboard [°/s]", "port [m]", "starboard [m]")
    means = "Turn rate and diameter of the steady turn at full steering."
    table = (Table(heads, "lrrrrr", tuple(circles), note=means),) if circles else ()
    plot = (Figure("circles", "Turning diameter against speed.", partial(_draw, authority)),) if circles[1:] else ()
    steerage = "Below the steerage limit, full steering does not turn the boat against its constant moment."
    said = _noted(steerage, "steerage" in authority.figures)
    yield Section("turning", "Turning", (*_table(rows), *said, *table, *plot), facts=IN_RESULT)


def _holding(authority: Authority, limits: Sequence[ParameterLimit]) -> Iterator[Section]:
    rows = [f for f in authority.figures.values() if f.slug.startswith(SECTION_OF["holding"])]
    said = _noted("Moments and forces are in percent of those at full output.", any(f.unit == "1" for f in rows))
    yield Section("holding", "What it can hold against", (*_table(rows), *said), facts=IN_RESULT)


def _limits(authority: Authority, limits: Sequence[ParameterLimit]) -> Iterator[Section]:
    rows = tuple(
        (
            row.name,
            UNKNOWN if math.isnan(row.present) else format_number(row.present, 4),
            format_number(row.value, 4),
            row.unit,
            row.rule,
        )
        for row in limits
    )
    motors = [row.name for row in limits if row.name.startswith("MOT_")]
    said = (f"After a change of {', '.join(motors)}, tune speed and heading again.",) if motors else ()
    table = Table(("parameter", "present", "proposed", "unit", "rule"), "lrrll", rows)
    yield Section("limits", "Parameters for ArduRover", (table, *(Note(text) for text in said)), facts=IN_RESULT)


def _undetermined(authority: Authority, limits: Sequence[ParameterLimit]) -> Iterator[Section]:
    texts = tuple(_sentence(row) for row in authority.missing)
    yield Section("missing", "Not determined by these models", tuple(bullets(texts)), facts=IN_RESULT)
    yield Section("assumed", "Assumptions", tuple(bullets(tuple(authority.assumed))), facts=IN_RESULT)


SECTIONS: tuple[Callable[[Authority, Sequence[ParameterLimit]], Iterator[Section]], ...] = (
    _speeds,
    _turning,
    _holding,
    _limits,
    _undetermined,
)
"""The sections in their order. To add one, add a function here."""


def _noted(text: str, applies: bool) -> tuple[Note, ...]:
    return (Note(text),) if applies else ()


def _sentence(row: Missing) -> str:
    return f"{row.what} Fly: {row.fly}."


def _table(figures: Sequence[AuthorityFigure]) -> Iterator[Part]:
    rows = []
    for figure in figures:
        unit, factor = _people(figure)
        low, high = (factor * end for end in figure.interval)
        std = factor * figure.std
        if figure.extrapolated:
            interval = EXTRAPOLATED
        else:
            known = std > 0.0 and math.isfinite(std)
            interval = f"{rounded_to(low, std)} to {rounded_to(high, std)}" if known else ""
        rows.append((figure.title, _short(figure), interval, pretty_unit(unit)))
    yield Table(HEADS, "lrrl", tuple(rows))
    notes = dict.fromkeys(note for f in figures if f.note for note in f.note.split("; "))
    yield from (Note(f"{note[0].upper()}{note[1:]}.") for note in notes)


def _people(figure: AuthorityFigure) -> tuple[str, float]:
    if figure.unit == "rad/s^2":
        return "°/s^2", math.degrees(1.0)
    if figure.slug.startswith(SECTION_OF["holding"]) and figure.unit == "1":
        return "%", 100.0
    return to_people(figure.unit)


def _short(figure: AuthorityFigure) -> str:
    _, factor = _people(figure)
    value, std = factor * figure.value, factor * figure.std
    return format_number(value, 4) if std == 0.0 or not math.isfinite(std) else rounded_to(value, std)


def _draw(authority: Authority) -> Drawing:
    figure, (axes,) = new_axes((2.2,))
    for side, colour in (("port", AFTER), ("starboard", WANTED)):
        rows = [(c.speed.value, c.diameters[side]) for c in authority.circles]
        speeds, diameters = [u for u, _ in rows], [d.value for _, d in rows]
        errors = [d.interval[1] - d.value for _, d in rows]
        axes.errorbar(speeds, diameters, yerr=errors, color=colour, marker="o", markersize=3, label=f"to {side}")
    axes.set_xlabel("speed [m/s]")
    axes.set_ylabel("diameter [m]")
    legend(axes)
    return figure
