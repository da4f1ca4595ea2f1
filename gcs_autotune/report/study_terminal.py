"""What ``identify`` prints."""

from __future__ import annotations

from collections.abc import Iterable

from rich.console import Group, RenderableType

from gcs_autotune.identify import AxisFit
from gcs_autotune.identify.method import Method
from gcs_autotune.report import study_tables, tables
from gcs_autotune.report.study import Study
from gcs_autotune.report.study_wording import answer_sentences, structure_title, unseen_remarks, verdict_headline
from gcs_autotune.report.terminal import STYLES, doubts_shown, grid, paragraph, title
from gcs_autotune.report.wording import decision_sentence, doubt_sentence

__all__ = ["method_list", "study_summary"]


def study_summary(study: Study) -> Group:
    """Return model, validation, structure decision, methods side by side, what cannot be told, doubts, verdict."""
    fit, answer = study.fit, study.answer
    parts: list[RenderableType] = [title(structure_title(fit)), grid(study_tables.parameter_table(fit, brief=True))]
    parts.extend(paragraph(s) for s in answer_sentences(study))
    if study.how_unseen:
        parts += [title("On data it has not seen"), paragraph(study.how_unseen)]
        parts.append(grid(study_tables.unseen_table(answer)))
        parts.extend(paragraph(s) for s in unseen_remarks(answer))
    if isinstance(fit, AxisFit) and (fit.decision is not None or fit.candidates) and not study.choice:
        parts.append(title("Which kind of damping"))
        if fit.decision is not None:
            parts.append(paragraph(decision_sentence(fit.decision)))
        if fit.candidates:
            parts.append(grid(tables.candidate_table(fit)))
    if study.choice:
        parts += [title("Which structure"), paragraph(study.choice_verdict), grid(study_tables.choice_table(study))]
    if len(study.outcomes) > 1:
        parts += [title("Methods side by side"), grid(study_tables.method_table(study))]
        parts.extend(grid(one) for one in study_tables.estimate_tables(study))
    if study.cannot_tell:
        parts += [title("What these runs cannot tell"), *(paragraph(s) for s in study.cannot_tell)]
    if study.intervals:
        parts += [title("Intervals by profile likelihood"), *(paragraph(s) for s in study.intervals)]
    if study.proposals:
        parts += [title("What to fly next"), paragraph(study.proposal_verdict)]
        parts.append(grid(study_tables.proposal_table(study)))
    parts.extend(doubts_shown(doubt_sentence(d) for d in fit.doubts))
    verdict = verdict_headline(study)
    parts.append(title(verdict.text, STYLES[verdict.tone]))
    return Group(*parts)


def method_list(methods: Iterable[Method]) -> Group:
    """Return every method with what it fits, and its options."""
    rows = []
    for m in methods:
        kinds = " and ".join(k for k, there in (("one axis", m.axis), ("coupled", m.coupled)) if there is not None)
        rows.append((m.name, kinds, m.summary))
        rows.extend(("", "", f"{name}: {text}") for name, text in m.options)
    return Group(grid(tables.Table(("method", "fits", "what; options"), "lll", tuple(rows))))
