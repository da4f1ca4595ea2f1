"""What ``diagnose`` prints, and the book of effects as a list."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from rich.console import Group, RenderableType

from gcs_autotune.diagnose import Diagnosis
from gcs_autotune.effects import CRAFT, INPUT, SIGNAL, Effect, Family, usual_bounds
from gcs_autotune.report import diagnosis_tables, diagnosis_wording
from gcs_autotune.report.diagnosis_names import effect_words
from gcs_autotune.report.numbers import pretty_unit
from gcs_autotune.report.tables import Table
from gcs_autotune.report.terminal import STYLES, bullet, doubts_shown, grid, paragraph, title
from gcs_autotune.report.wording import doubt_sentence, sentence

__all__ = ["diagnosis_summary", "effects_list", "effects_to_dict"]

MOST_RANKED = 5
"""Candidates shown of each step; the page and the JSON have them all."""

FAMILIES: Mapping[Family, str] = {
    "data errors": "Bookkeeping: the file, not the craft",
    "actuator": "Actuators",
    "hydrodynamics": "Water and inertia",
    "environment": "Wind, waves, current, tether",
    "sensor": "Sensors",
}
"""Family -> heading, in the order of looking."""


def diagnosis_summary(told: Diagnosis) -> Group:
    """Return verdict, causes, gains, ranking, what these runs cannot tell, what remains, what to fly next, doubts."""
    headline = diagnosis_wording.verdict_headline(told)
    parts: list[RenderableType] = [title(headline.text, STYLES[headline.tone])]
    parts.extend(paragraph(s) for s in headline.sentences)
    if told.numbers is not None and told.numbers.rows:
        parts.append(title(diagnosis_wording.numbers_title(told.numbers)))
        parts.append(grid(diagnosis_tables.numbers_table(told.numbers)))
        if told.numbers.gains:
            parts.append(title("Numbers set right, on unseen data"))
            parts.append(grid(diagnosis_tables.gains_table(told.numbers.gains)))
    for cause in told.causes:
        parts.append(title(diagnosis_wording.cause_title(told, cause)))
        parts.append(paragraph(sentence(cause.meaning)))
        if cause.parameters:
            parts.append(grid(diagnosis_tables.cause_table(cause)))
    if told.causes and told.gains:
        parts += [title("On data it has not seen"), grid(diagnosis_tables.gains_table(told.gains))]
    for heading, ranked in diagnosis_tables.steps_of(told):
        parts += [title(heading), grid(diagnosis_tables.ranking_table(ranked[:MOST_RANKED], brief=True))]
    if told.indistinguishable:
        parts.append(title("What these runs cannot tell"))
        parts.extend(bullet(s) for s in diagnosis_wording.cannot_tell(told))
    parts.append(title("What remains"))
    parts.extend(bullet(s) for s in told.left.findings or ("Nothing that could be told from noise.",))
    if told.next_manoeuvre:
        parts += [title("What to fly next"), paragraph(sentence(told.next_manoeuvre))]
    if told.doubts:
        parts.extend(doubts_shown(doubt_sentence(d) for d in told.doubts))
    parts.append(title("What this rests on"))
    parts.extend(paragraph(s) for s in diagnosis_wording.rests_on(told))
    return Group(*parts)


def effects_list(book: Mapping[str, Effect]) -> Group:
    """Return every effect by family: slug, meaning, parameters with units, what it is mistaken for, what separates."""
    parts: list[RenderableType] = []
    for family, heading in FAMILIES.items():
        rows: list[tuple[str, str]] = []
        for effect in (e for e in book.values() if e.family == family):
            rows.append((effect.slug, sentence(effect.meaning)))
            bounds = usual_bounds(effect)
            rows.extend(
                ("", f"{q.name} [{_unit(q.unit)}]: {q.meaning}{_between(bounds[q.name])}") for q in effect.parameters
            )
            rows.append(("", f"shows in {effect.shown_by}"))
            if effect.mistaken_for:
                others = ", ".join(effect_words(s) for s in effect.mistaken_for)
                rows.append(("", f"mistaken for {others}; told apart by {effect.separated_by}"))
        if rows:
            parts += [title(heading), grid(Table(("effect", "what; parameters"), "ll", tuple(rows)))]
    return Group(*parts, paragraph(f"Bounds are those of a craft to scale from: {CRAFT}; a fit takes its runs' own."))


def _between(bounds: tuple[float, float]) -> str:
    low, high = bounds
    if math.isfinite(low) and math.isfinite(high):
        return f", {low:.3g} to {high:.3g}"
    if math.isfinite(low):
        return f", at least {low:.3g}"
    return f", at most {high:.3g}" if math.isfinite(high) else ""


def _unit(unit: str) -> str:
    return pretty_unit(unit.replace(INPUT, "unit of the input").replace(SIGNAL, "unit of the signal")) or "1"


def effects_to_dict(book: Mapping[str, Effect]) -> dict[str, Any]:
    """Return the JSON form of the book, in its own order; units with the words the entries use."""
    return {
        "schema": 1,
        "bounds_of": CRAFT,
        "effects": [
            {
                "slug": e.slug,
                "family": e.family,
                "meaning": e.meaning,
                "parameters": _parameters(e),
                "shown_by": e.shown_by,
                "mistaken_for": list(e.mistaken_for),
                "separated_by": e.separated_by,
            }
            for e in book.values()
        ],
    }


def _parameters(effect: Effect) -> list[dict[str, Any]]:
    bounds = usual_bounds(effect)
    return [
        {
            "name": q.name,
            "unit": q.unit,
            "meaning": q.meaning,
            "bounds": [b if math.isfinite(b) else None for b in bounds[q.name]],
        }
        for q in effect.parameters
    ]
