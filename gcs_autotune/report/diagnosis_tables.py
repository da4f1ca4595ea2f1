"""The rows of a diagnosis' tables."""

from __future__ import annotations

import math
from collections.abc import Iterable

from gcs_autotune.diagnose import Cause, Diagnosis, Gain, Numbers, Ranked
from gcs_autotune.effects import EFFECTS
from gcs_autotune.report.diagnosis_names import effect_words, place_words, signal_words, value_words
from gcs_autotune.report.diagnosis_wording import found_words, given_words, interval_words, standing
from gcs_autotune.report.numbers import UNKNOWN, format_error, format_number, format_share
from gcs_autotune.report.tables import Table

__all__ = ["cause_table", "format_p", "gains_table", "numbers_table", "ranking_table", "steps_of"]


def cause_table(cause: Cause) -> Table:
    """A cause's parameters with what they mean."""
    entry = EFFECTS.get(cause.effect.slug)
    meaning = {} if entry is None else {q.name: q.meaning for q in entry.parameters}
    rows = tuple((name, value_words(v, name), meaning.get(name, "")) for name, v in cause.parameters.items())
    return Table(("parameter", "value ± standard error", "meaning"), "lrl", rows)


def gains_table(gains: Iterable[Gain]) -> Table:
    """Per signal the error on held-out data before and after."""
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
    """Each number of the given model, or of the plain model fitted to a simulation, against the runs."""
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
    head = ("number", *(("what it is",) if explained else ()), numbers.of, "these runs (95 %)", "")
    return Table(head, "llrrl" if explained else "lrrl", rows)


def ranking_table(ranking: Iterable[Ranked], *, brief: bool = False) -> Table:
    """Candidates, best first; *brief* for 80 columns."""
    rows = tuple(
        (
            r.cause,
            r.place if brief else place_words(r.place),
            format_share(r.gain) if math.isfinite(r.gain) else UNKNOWN,
            format_p(r.p_value),
            format_number(r.evidence, 3),
            ", ".join(f"{n} {value_words(v, n)}" for n, v in r.parameters.items()),
        )
        for r in ranking
    )
    return Table(("effect", "where", "gain", "p", "evidence", "parameters"), "llrrrl", rows)


def format_p(p: float) -> str:
    """Return a p-value with two digits; below 1e-15 it is only said to be smaller."""
    return "< 1e-15" if p < 1e-15 else format_number(p, 2)


def steps_of(told: Diagnosis) -> tuple[tuple[str, tuple[Ranked, ...]], ...]:
    """Return (heading, candidates): tried against the base model, then beside the first cause, and so on."""
    told_steps = []
    for step in sorted({r.step for r in told.ranking}):
        earlier = ", ".join(effect_words(c.effect.slug) for c in told.causes[: step - 1])
        heading = f"Tried beside {earlier}" if earlier else "Tried against the simulation"
        told_steps.append((heading, tuple(r for r in told.ranking if r.step == step)))
    return tuple(told_steps)
