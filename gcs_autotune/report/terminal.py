"""Tables and verdicts for the terminal: legible without colour, at 80 columns, and through a pipe.

Each function returns something a ``rich`` console prints; nothing here prints by itself.
"""

from __future__ import annotations

import io
from collections.abc import Iterable
from pathlib import PurePath

from rich import box
from rich.console import Console, Group, RenderableType
from rich.padding import Padding
from rich.table import Table as RichTable
from rich.text import Text

from gcs_autotune.design.result import Proposal
from gcs_autotune.foreign_text import visible
from gcs_autotune.identify.result import AxisFit
from gcs_autotune.report import tables
from gcs_autotune.report.story import TuneStory
from gcs_autotune.report.wording import (
    PROOF_SENTENCE,
    Tone,
    bound_sentence,
    decision_sentence,
    doubt_sentence,
    headline,
    improvement,
    model_sentences,
    model_words,
    proof_command,
    safety,
    undo_command,
)

__all__ = [
    "STYLES",
    "bullet",
    "doubts_shown",
    "fit_summary",
    "gains_summary",
    "grid",
    "paragraph",
    "render_text",
    "show_tune",
    "title",
    "tune_summary",
]

STYLES: dict[Tone, str] = {"good": "bold green", "neutral": "bold", "bad": "bold red"}
"""Tone of a verdict -> how a terminal shows it."""


def render_text(thing: RenderableType, width: int = 80) -> str:
    """Return *thing* as plain text, as it looks in a pipe: no colour, no trailing blanks."""
    console = Console(file=io.StringIO(), width=width, color_system=None, force_terminal=False, legacy_windows=False)
    with console.capture() as capture:
        console.print(thing)
    return "\n".join(line.rstrip() for line in capture.get().rstrip().splitlines()) + "\n"


def fit_summary(fit: AxisFit) -> Group:
    """Return what ``identify`` shows: model, structure and how it was decided, doubts with cures."""
    parts: list[RenderableType] = [title(f"Model of {fit.dof}: {model_words(fit)} ({fit.structure})")]
    parts.append(grid(tables.model_table(fit)))
    parts.extend(paragraph(s) for s in model_sentences(fit))
    parts.append(paragraph(f"Method: {fit.method}, from {', '.join(fit.used)}."))
    if fit.decision is not None:
        parts.extend((title("Which kind of damping"), paragraph(decision_sentence(fit.decision))))
    if fit.candidates:
        parts.append(grid(tables.candidate_table(fit)))
    parts.extend(doubts_shown(doubt_sentence(d) for d in fit.doubts))
    return Group(*parts)


def gains_summary(proposal: Proposal) -> Group:
    """Return old and new gains side by side, what they promise, and how safe that is."""
    parts: list[RenderableType] = [title(f"Gains for {proposal.axis}"), grid(tables.gains_table(proposal.changes))]
    parts.append(paragraph(improvement(proposal.before.metrics, proposal.after.metrics, "predicted")))
    parts.append(paragraph(safety(proposal), "" if proposal.worst_margins.stable else "bold red"))
    parts.extend(paragraph(note) for note in proposal.notes)
    parts.append(grid(tables.margins_table(proposal)))
    parts.append(paragraph(bound_sentence(proposal.bound)))
    return Group(*parts)


def tune_summary(story: TuneStory) -> Group:
    """Return how a tune ended: the gains, the measured step, the doubts, and last, where the eye is, the verdict."""
    return Group(*_details(story), *_verdict(story))


def _verdict(story: TuneStory) -> list[RenderableType]:
    verdict = headline(story)
    return [title(verdict.text, STYLES[verdict.tone]), *(paragraph(s) for s in verdict.sentences)]


def _details(story: TuneStory) -> list[RenderableType]:
    parts: list[RenderableType] = []
    if story.changes:
        parts.append(grid(tables.gains_table(story.changes)))
    if story.metrics_before is not None:
        parts.append(grid(tables.metrics_table(story.metrics_before, story.metrics_after)))
    parts.extend(bullet(reason) for reason in story.verdict_reasons)
    doubts = (*story.doubts, *(doubt_sentence(d) for d in (story.fit.doubts if story.fit else ())))
    if doubts or story.fit is not None:
        parts.extend(doubts_shown(doubts))
    return parts


def show_tune(console: Console, story: TuneStory) -> None:
    """Print :func:`tune_summary`, and before the verdict how to undo and where the report is, whole on their lines."""
    console.print(Group(*_details(story)))
    if story.ending == "kept":
        console.print(Text(f"\nTo undo:\n  {undo_command(story)}"), soft_wrap=True)
    if story.awaits_proof and story.proving:
        console.print(Text(f"\n{PROOF_SENTENCE}\n  {proof_command(story)}"), soft_wrap=True)
    if story.directory:
        console.print(Text(f"\nReport: {PurePath(story.directory) / 'report.html'}"), soft_wrap=True)
    console.print(Group(*_verdict(story)))


def doubts_shown(texts: Iterable[str]) -> list[RenderableType]:
    """Return the block of doubts, or the sentence that there are none."""
    found = list(texts)
    if not found:
        return [paragraph("The fit raises no doubts.")]
    return [title("What to doubt", "bold yellow"), *(bullet(text) for text in found)]


def bullet(text: str) -> RichTable:
    """Return one line of a list."""
    line = RichTable.grid(padding=(0, 1))
    line.add_row(Text(" -"), Text(visible(text)))
    return line


def title(text: str, style: str = "bold") -> RenderableType:
    """Return a heading."""
    return Padding(Text(visible(text), style=style), (1, 0, 0, 0))


def paragraph(text: str, style: str = "") -> Text:
    """Return a paragraph."""
    return Text(visible(text), style=style)


def grid(table: tables.Table) -> Padding:
    """Return a table, without the columns that hold nothing."""
    lines = RichTable(box=box.SIMPLE, pad_edge=False, show_edge=False, header_style="bold")
    used = [i for i in range(len(table.heads)) if table.heads[i] or any(row[i] for row in table.rows)]
    used = [i for i in used if any(row[i] for row in table.rows) or not table.rows]
    for i in used:
        right = table.align[i] == "r"
        lines.add_column(Text(visible(table.heads[i])), justify="right" if right else "left", no_wrap=right or i == 0)
    for row in table.rows:
        lines.add_row(*(Text(visible(row[i])) for i in used))
    if table.note:
        return Padding(Group(lines, Text(visible(table.note))), (1, 0))
    return Padding(lines, (1, 0))
