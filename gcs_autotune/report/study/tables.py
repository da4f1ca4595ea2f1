"""The tables of an identification, and the output of ``identify``."""

from __future__ import annotations

import math
from collections.abc import Iterable

from rich.console import Group, RenderableType

from gcs_autotune.identify import AxisFit, Fit, Method, Parameter, Validation
from gcs_autotune.report.study.study import (
    MethodOutcome,
    Study,
    answer_sentences,
    comparison_sentences,
    fits_sentence,
    structure_title,
    unseen_remarks,
    verdict_headline,
)
from gcs_autotune.report.toolkit.axis_fit import (
    candidate_table,
    decision_sentence,
    fit_summary,
    meanings,
    model_table,
    short_name,
)
from gcs_autotune.report.toolkit.page import Table
from gcs_autotune.report.toolkit.terminal import STYLES, contradictions_shown, doubts_shown, grid, paragraph, title
from gcs_autotune.report.toolkit.wording import (
    UNKNOWN,
    contradictions_in,
    doubt_sentence,
    format_error,
    format_number,
    format_parameter,
    format_percent,
    format_seconds,
    pretty_unit,
)
from gcs_autotune.sname import signal_meaning

__all__ = [
    "choice_table",
    "estimate_tables",
    "method_list",
    "method_table",
    "model_summary",
    "parameter_table",
    "proposal_table",
    "run_table",
    "study_summary",
    "unseen_table",
]


ABREAST = 3
"""Parameters per table of estimates; as many as fit in 80 columns."""

_FORCES = {
    "X": "surge force",
    "Y": "sway force",
    "Z": "heave force",
    "K": "roll moment",
    "M": "pitch moment",
    "N": "yaw moment",
}

_STATES = {
    "u": "surge",
    "v": "sway",
    "w": "heave",
    "p": "roll rate",
    "q": "pitch rate",
    "r": "yaw rate",
    "phi": "roll angle",
    "theta": "pitch angle",
    "z": "depth",
}

_NAMED = {
    "m": "mass",
    "I_x": "moment of inertia in roll",
    "I_y": "moment of inertia in pitch",
    "I_z": "moment of inertia in yaw",
    "I_xz": "product of inertia",
    "x_G": "centre of gravity, ahead",
    "y_G": "centre of gravity, to starboard",
    "z_G": "centre of gravity, down",
    "delay": "input delay",
    "lag": "first-order lag of the force",
    "V_x": "current to the north",
    "V_y": "current to the east",
}


def parameter_table(fit: Fit, *, brief: bool = False) -> Table:
    """Return every parameter rounded to its standard error, with the Cramér-Rao bound; *brief* for 80 columns."""
    if isinstance(fit, AxisFit) and all(math.isnan(p.bound) for p in fit.parameters.values()):
        return model_table(fit)
    axis = meanings(fit) if isinstance(fit, AxisFit) else None
    rows = tuple(
        (
            short_name(p.name) if axis is not None else p.name,
            "0" if p.status == "absent" else format_parameter(p.name, p.value, p.std, p.unit),
            pretty_unit(p.unit) or "1",
            _relative(p),
            _over_bound(p),
            meaning_of(p.name) if axis is None else axis.get(p.name, ""),
            _remark(p),
        )
        for p in fit.parameters.values()
    )
    table = Table(("parameter", "value ± std", "unit", "std", "std / bound", "meaning", "remark"), "lrlrrll", rows)
    return _without(table, "meaning") if brief else table


def _without(table: Table, head: str) -> Table:
    out = table.heads.index(head)
    rows = tuple(tuple(c for i, c in enumerate(row) if i != out) for row in table.rows)
    return Table(table.heads[:out] + table.heads[out + 1 :], table.align[:out] + table.align[out + 1 :], rows)


def _relative(p: Parameter) -> str:
    if p.std <= 0.0 or not math.isfinite(p.std) or p.value == 0.0:
        return ""
    return format_percent(100.0 * p.std / abs(p.value))


def _over_bound(p: Parameter) -> str:
    return format_number(p.std / p.bound, 3) if p.bound > 0.0 and math.isfinite(p.std) else ""


def _remark(p: Parameter) -> str:
    if p.status == "fitted" and p.std > abs(p.value) > 0.0:
        return "not distinct from zero"
    if p.status == "at_bound" and p.value == 0.0:
        return "none"
    return {"fitted": "", "absent": "absent", "fixed": "known"}.get(p.status, "AT ITS BOUND")


def meaning_of(name: str) -> str:
    """Return the meaning of a derivative; empty if unknown."""
    if name in _NAMED:
        return _NAMED[name]
    force, _, rest = name.partition("_")
    if force not in _FORCES or not rest:
        return ""
    if rest == "0":
        return f"constant {_FORCES[force]}"
    if rest.endswith("dot"):
        return f"added mass: {_FORCES[force]} by {_STATES.get(rest[:-3], rest[:-3])} acceleration"
    if rest in _STATES:
        return f"{_FORCES[force]} by {_STATES[rest]}"
    if len(rest) == 2 and rest[0] == rest[1] and rest[0] in _STATES:
        return f"{_FORCES[force]} by {_STATES[rest[0]]} squared"
    return f"{_FORCES[force]} by {rest}"


def method_table(study: Study) -> Table:
    """Return fit and held-out prediction of each method, or the reason for its refusal."""
    return Table(
        ("method", "fit", "held out", "time", "remark"), "lrrrl", tuple(_method_row(o) for o in study.outcomes)
    )


def _method_row(outcome: MethodOutcome) -> tuple[str, ...]:
    if outcome.fit is None:
        return (outcome.method, "", "", "", outcome.refusal)
    unseen = "" if outcome.unseen is None else format_percent(outcome.unseen.fit_percent)
    doubts = ", ".join(d.slug for d in outcome.fit.doubts)
    return (outcome.method, format_percent(outcome.fit.fit_percent), unseen, format_seconds(outcome.seconds), doubts)


def estimate_tables(study: Study) -> tuple[Table, ...]:
    """Return the estimates of each method, a few parameters per table."""
    fits = [o.fit for o in study.outcomes if o.fit is not None]
    names = list(dict.fromkeys(n for f in fits for n, p in f.parameters.items() if p.std > 0.0))
    tables = []
    for first in range(0, len(names), ABREAST):
        some = names[first : first + ABREAST]
        rows = tuple((f.method, *(_estimate(f, n) for n in some)) for f in fits)
        tables.append(Table(("method", *some), "l" + "r" * len(some), rows))
    return tuple(tables)


def _estimate(fit: Fit, name: str) -> str:
    found = fit.parameters.get(name)
    if found is None or found.status == "absent":
        return ""
    return format_parameter(name, found.value, found.std, found.unit)


def run_table(study: Study) -> Table:
    """Return the runs, their contents and their use."""
    rows = tuple((r.name, format_seconds(r.duration), str(r.samples), " ".join(r.signals), r.role) for r in study.runs)
    return Table(("run", "length", "samples", "channels", "used for"), "lrrll", rows)


def unseen_table(found: Validation | None, dof: str) -> Table:
    """Return the free-run prediction of held-out data by a fit of degree of freedom or form *dof*."""
    pairs = () if found is None else zip(found.traces, found.statistics, strict=True)
    rows = tuple(
        (
            t.run,
            f"{t.signal}, {signal_meaning(t.signal, dof)}",
            format_percent(s.fit_percent) if math.isfinite(s.fit_percent) else UNKNOWN,
            format_error(s.rms, t.unit, 3),
            format_error(s.worst, t.unit, 3),
        )
        for t, s in pairs
    )
    return Table(("run", "signal", "fit", "rms error", "worst"), "llrrr", rows)


def choice_table(study: Study) -> Table:
    """Return the comparison of structures."""
    return Table(("structure", "held-out error", "BIC - best", "verdict"), "lrrl", study.choice)


def proposal_table(study: Study) -> Table:
    """Return the proposed manoeuvres, best first."""
    return Table(("manoeuvre", "how", "expected improvement", "needs"), "llll", study.proposals)


def study_summary(study: Study) -> Group:
    """Return model, validation, choice of structure, comparison of methods, doubts and verdict."""
    fit, answer = study.fit, study.answer
    parts = contradictions_shown(contradictions_in(fit.doubts))
    parts += [title(structure_title(fit)), grid(parameter_table(fit, brief=True))]
    parts.extend(paragraph(s) for s in answer_sentences(study))
    if study.how_unseen:
        parts += [title("Held-out prediction"), paragraph(study.how_unseen)]
        parts.append(grid(unseen_table(answer.unseen, fit.dof)))
        parts.extend(paragraph(s) for s in unseen_remarks(answer))
    if isinstance(fit, AxisFit) and (fit.decision is not None or fit.candidates) and not study.choice:
        parts.append(title("Choice of damping"))
        if fit.decision is not None:
            parts.append(paragraph(decision_sentence(fit)))
        if fit.candidates:
            parts.append(grid(candidate_table(fit)))
    if study.choice:
        parts += [title("Choice of structure"), paragraph(study.choice_verdict), grid(choice_table(study))]
    if len(study.outcomes) > 1:
        parts += [title("Comparison of methods"), grid(method_table(study))]
        parts.extend(grid(one) for one in estimate_tables(study))
    if study.cannot_tell:
        parts += [title("What these runs do not determine"), *(paragraph(s) for s in study.cannot_tell)]
    if study.intervals:
        parts += [title("Intervals by profile likelihood"), *(paragraph(s) for s in study.intervals)]
    if study.comparisons:
        parts += [title(f"Comparison with {study.compared_with}"), *(paragraph(s) for s in comparison_sentences(study))]
    if study.proposals:
        parts += [title("What to fly next"), paragraph(study.proposal_verdict)]
        parts.append(grid(proposal_table(study)))
    parts.extend(doubts_shown(doubt_sentence(d) for d in fit.doubts))
    verdict = verdict_headline(study)
    parts.append(title(verdict.text, STYLES[verdict.tone]))
    return Group(*parts)


def model_summary(fit: Fit) -> Group:
    """Return a single model of any form: parameters, fit, doubts."""
    if isinstance(fit, AxisFit):
        return fit_summary(fit)
    parts: list[RenderableType] = [title(structure_title(fit)), grid(parameter_table(fit, brief=True))]
    parts.append(paragraph(fits_sentence(fit)))
    parts.extend(doubts_shown(doubt_sentence(d) for d in fit.doubts))
    return Group(*parts)


def method_list(methods: Iterable[Method]) -> Group:
    """Return every method with its kinds of models and its options."""
    rows = []
    for m in methods:
        kinds = " and ".join(k for k, there in (("one axis", m.axis), ("coupled", m.coupled)) if there is not None)
        rows.append((m.name, kinds, m.summary))
        rows.extend(("", "", f"{name}: {text}") for name, text in m.options)
    return Group(grid(Table(("method", "fits", "what; options"), "lll", tuple(rows))))
