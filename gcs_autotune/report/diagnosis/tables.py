"""The tables of a diagnosis, and the list of effects."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict
from typing import Any

from gcs_autotune.diagnose import Cause, Diagnosis, ErrorReduction, Numbers, Ranked, TableFinding
from gcs_autotune.effects import CRAFT, EFFECTS, INPUT, SIGNAL, Effect, Family, effect_words, usual_bounds
from gcs_autotune.report.diagnosis.wording import (
    found_words,
    given_words,
    interval_words,
    place_words,
    signal_words,
    standing,
    value_words,
)
from gcs_autotune.report.toolkit.document import IN_RESULT, Document, Note, Section, Table
from gcs_autotune.report.toolkit.wording import (
    UNKNOWN,
    format_error,
    format_number,
    format_share,
    pretty_unit,
    sentence,
)
from gcs_autotune.rounding import counted

__all__ = [
    "cause_table",
    "effects_document",
    "effects_to_dict",
    "format_p",
    "gains_table",
    "numbers_table",
    "parameter_table_document",
    "ranking_table",
    "steps_of",
]


def cause_table(cause: Cause) -> Table:
    """Return a table of a cause's parameters with their values and meanings."""
    entry = EFFECTS.get(cause.effect.slug)
    meaning = {} if entry is None else {q.name: q.meaning for q in entry.parameters}
    rows = tuple((name, value_words(v, name), meaning.get(name, "")) for name, v in cause.parameters.items())
    return Table(("parameter", "value ± standard error", "meaning"), "lrl", rows)


def gains_table(gains: Iterable[ErrorReduction]) -> Table:
    """Return a table of the held-out error of each signal, without and with the causes."""
    rows = tuple(
        (
            f"{signal_words(g.signal)} ({g.signal})",
            format_error(g.before, g.unit, 3),
            format_error(g.after, g.unit, 3),
            format_share(g.ratio) if math.isfinite(g.ratio) else UNKNOWN,
            interval_words(g) or UNKNOWN,
        )
        for g in gains
    )
    return Table(("error of (RMS)", "before", "after", "after / before", "95 % interval"), "lrrrr", rows)


def numbers_table(numbers: Numbers) -> Table:
    """Return a table of all numbers of a model and their values from the runs.

    The model is the user-supplied one, or the plain model fitted to a simulation.
    """
    explained = numbers.of == "model"
    rows = tuple(
        (
            n.name,
            *((n.meaning,) if explained else ()),
            given_words(n),
            found_words(n),
            standing(n),
        )
        for n in numbers.rows
    )
    head = ("number", *(("meaning",) if explained else ()), f"{numbers.of} (95 %)", "these runs (95 %)", "")
    return Table(head, "llrrl" if explained else "lrrl", rows)


def ranking_table(ranking: Iterable[Ranked]) -> Table:
    """Return the table of candidate effects, best first. The page folds all but the best :data:`MOST_RANKED`."""
    rows = tuple(
        (
            effect_words(r.cause),
            place_words(r.place),
            format_share(r.gain) if math.isfinite(r.gain) else UNKNOWN,
            format_p(r.p_value),
            format_number(r.evidence, 3),
            ", ".join(f"{n} {value_words(v, n)}" for n, v in r.parameters.items()),
        )
        for r in ranking
    )
    heads = ("effect", "where", "gain", "p", "evidence", "parameters")
    return Table(heads, "llrrrl", rows, shown=MOST_RANKED if len(rows) > MOST_RANKED else None)


def format_p(p: float) -> str:
    """Return a p-value with two digits; below 1e-15 as ``< 1e-15``."""
    return "< 1e-15" if p < 1e-15 else format_number(p, 2)


def steps_of(diagnosis: Diagnosis) -> tuple[tuple[str, tuple[Ranked, ...]], ...]:
    """Return (heading, candidates) of each step of the search. The first step adds an effect to the base model, the
    next one adds an effect after the first cause, and so on.
    """
    told_steps = []
    for step in sorted({r.step for r in diagnosis.ranking}):
        earlier = ", ".join(effect_words(c.effect.slug) for c in diagnosis.causes[: step - 1])
        heading = f"Candidates added after {earlier}" if earlier else "Candidates added to the simulation"
        told_steps.append((heading, tuple(r for r in diagnosis.ranking if r.step == step)))
    return tuple(told_steps)


MOST_RANKED = 5
"""Number of candidates shown per step of the search. The page folds the others, and JSON contains all. Project
choice.
"""

FAMILIES: Mapping[Family, str] = {
    "data errors": "Data errors (in the file, not the craft)",
    "actuator": "Actuators",
    "hydrodynamics": "Hydrodynamics and inertia",
    "environment": "Wind, waves, current, tether",
    "sensor": "Sensors",
}
"""Family of effects -> heading, in the order of the search."""


def effects_document(effects: Mapping[str, Effect]) -> Document:
    """Return the list of all effects by family: slug, meaning, parameters with units, similar effects, how to
    distinguish them.
    """
    sections: list[Section] = []
    for family, heading in FAMILIES.items():
        rows: list[tuple[str, str]] = []
        for effect in (e for e in effects.values() if e.family == family):
            rows.append((effect.slug, sentence(effect.meaning)))
            bounds = usual_bounds(effect)
            rows.extend(
                ("", f"{q.name} [{_unit(q.unit)}]: {q.meaning}{_between(bounds[q.name])}") for q in effect.parameters
            )
            rows.append(("", f"shows in {effect.shown_by}"))
            if effect.mistaken_for:
                others = ", ".join(effect_words(s) for s in effect.mistaken_for)
                rows.append(("", f"easily mistaken for {others}; to distinguish: {effect.separated_by}"))
        if rows:
            table = Table(("effect", "what; parameters"), "ll", tuple(rows))
            sections.append(Section(family.replace(" ", "-"), heading, (table,), facts=IN_RESULT))
    about = Note(f"The bounds shown are for a reference craft: {CRAFT}. A fit derives its own from the runs.")
    sections.append(Section("bounds", "Bounds", (about,), facts=IN_RESULT))
    return Document("Effects", tuple(sections), facts=effects_to_dict(effects))


def parameter_table_document(name: str, findings: Sequence[TableFinding]) -> Document:
    """Return the report of a table of identified parameters: whether its rows describe one craft."""
    off = [f for f in findings if f.answer == "yes"]
    unsure = sum(f.answer == "cannot tell" for f in findings)
    verdict = counted(len(off), "contradiction") if off else "No contradiction between the rows"
    shown = [f for f in findings if f.answer == "yes" or f.question not in ("level", "row")]
    rows = tuple((f.question, f.quantity, f.where, f.answer, _table_share(f), format_p(f.p)) for f in shown)
    readings = dict.fromkeys(sentence(f.reading) for f in findings if f.reading and f.answer == "yes")
    parts: tuple[Note | Table, ...] = (
        Note(f"{verdict}. {unsure} of {len(findings)} questions cannot be answered because of the scatter."),
        *(Note(reading) for reading in readings),
        Table(("question", "quantity", "where", "differs", "difference [95 %]", "p"), "llllrr", rows),
    )
    facts = {"schema": 1, "table": name, "findings": [asdict(f) for f in findings]}
    return Document(f"Table {name}", (Section("table", f"Table {name}", parts, facts=IN_RESULT),), facts=facts)


def _table_share(f: TableFinding) -> str:
    low, high = f.ci95
    if f.question == "drag-order":
        return f"{f.share:.2f} [{low:.2f}, {high:.2f}]"
    return f"{100.0 * f.share:+.0f} % [{100.0 * low:+.0f}, {100.0 * high:+.0f}]"


def _between(bounds: tuple[float, float]) -> str:
    low, high = bounds
    if math.isfinite(low) and math.isfinite(high):
        return f", {low:.3g} to {high:.3g}"
    if math.isfinite(low):
        return f", at least {low:.3g}"
    return f", at most {high:.3g}" if math.isfinite(high) else ""


def _unit(unit: str) -> str:
    return pretty_unit(unit.replace(INPUT, "unit of the input").replace(SIGNAL, "unit of the signal")) or "1"


def effects_to_dict(effects: Mapping[str, Effect]) -> dict[str, Any]:
    """Return the JSON form of the table of effects, in its own order and with units as in the entries."""
    return {
        "schema": 1,
        "bounds_of": CRAFT,
        "effects": [
            {
                "slug": e.slug,
                "family": e.family,
                "meaning": e.meaning,
                "structural": e.is_structural,
                "parameters": _parameters(e),
                "shown_by": e.shown_by,
                "mistaken_for": list(e.mistaken_for),
                "separated_by": e.separated_by,
            }
            for e in effects.values()
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
