"""Show a document on the terminal, legible without colour, at 80 columns and through a pipe."""

from __future__ import annotations

import io
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from rich import box
from rich.cells import cell_len
from rich.console import Console, ConsoleOptions, Group, RenderableType, RenderResult
from rich.padding import Padding
from rich.panel import Panel
from rich.table import Table as RichTable
from rich.text import Text

from gcs_autotune.report.toolkit.document import Document, Figure, Note, Part, Section, Table, Tone, is_empty
from gcs_autotune.report.toolkit.tied import TiedText
from gcs_autotune.report.toolkit.wording import with_signs
from gcs_autotune.untrusted_text import visible

__all__ = ["STYLES", "print_document", "render_text", "to_terminal"]


STYLES: Mapping[Tone, str] = {"good": "bold green", "neutral": "bold", "bad": "bold red"}
"""Tone of a verdict -> terminal style."""

DOUBTFUL = "bold yellow"

LAST = ("next",)
"""Sections that stand directly above the verdict."""

COMMANDS = ("resume", "undo")
"""Sections directly below the verdict, without their titles, because a screen of 24 lines holds them with it."""

BOX = 80
"""Width of the box with the verdict [characters], if the terminal is not narrower. Project choice."""


def to_terminal(document: Document) -> Group:
    """Return *document* as a ``rich`` renderable, without figures and details. Print it with :func:`print_document`.

    Contradictions come first. The document ends with its lead and verdict in a box, and the commands that continue or
    undo below it, because doubts may have any length. What to do next stands directly above the box.
    """
    return Group(*_pieces(document))


def print_document(console: Console, document: Document) -> None:
    """Print *document* on a terminal as :func:`to_terminal` formats it. A command to copy stays on one line at
    any length.
    """
    console.print(to_terminal(document), crop=False)


def render_text(document: Document, width: int = 80) -> str:
    """Return *document* as plain text, as printed into a pipe: without colour and trailing blanks."""
    console = Console(file=io.StringIO(), width=width, color_system=None, force_terminal=False, legacy_windows=False)
    with console.capture() as capture:
        print_document(console, document)
    return "\n".join(line.rstrip() for line in capture.get().rstrip().splitlines()) + "\n"


def _pieces(document: Document) -> Iterator[RenderableType]:
    if document.contradictions:
        yield _title("Columns that contradict each other", STYLES["bad"])
        yield from (_bullet(text) for text in document.contradictions)
    for section in document.sections:
        if section.slug not in (*LAST, *COMMANDS):
            yield from _section(section)
    if document.doubts:
        yield _title("Doubts" if document.doubted == "fit" else f"Doubts about the {document.doubted}", DOUBTFUL)
        yield from (_bullet(f"{word}: {doubt.text}") for word, doubt in document.graded)
    elif document.doubts is not None:
        yield _apart(_text(f"No doubts about the {document.doubted}."))
    for section in document.sections:
        if section.slug in LAST:
            yield from _section(section)
    yield from _verdict(document)
    for section in document.sections:
        if section.slug in COMMANDS and not section.detail:
            yield from (piece for part in section.parts for piece in _part(part))


def _verdict(document: Document) -> Iterator[RenderableType]:
    verdict = document.verdict
    if verdict is None:
        return
    style = STYLES[verdict.tone]
    sentences = [_text(sentence) for sentence in verdict.sentences]
    lead = [TiedText(with_signs(visible(document.lead)), style=style)] if document.lead else []
    said = Group(*lead, TiedText(with_signs(visible(verdict.text)), style="" if lead else style), *sentences)
    yield _apart(Panel(said, box=box.ROUNDED, border_style=style.removeprefix("bold "), width=BOX))


def _section(section: Section) -> Iterator[RenderableType]:
    """Yield heading and parts, or nothing if the terminal shows no part of it."""
    if section.detail:
        return
    pieces, is_after_table = [], False
    for part in section.parts:
        for piece in _part(part):
            pieces.append(_apart(piece) if is_after_table and isinstance(part, Note) else piece)
            is_after_table = isinstance(part, Table)
    if pieces:
        yield _title(section.title)
        yield from pieces


def _part(part: Part) -> Iterator[RenderableType]:
    if isinstance(part, Section):
        yield from _section(part)
    elif is_empty(part) or isinstance(part, Figure) or part.detail:
        return
    elif isinstance(part, Table):
        yield _Grid(part)
    elif part.kind == "bullet":
        yield _bullet(part.text)
    elif part.kind == "command":
        yield from ([_text(part.label)] if part.label else [])
        yield Text(f"  {visible(part.text)}", no_wrap=True, overflow="ignore")
    elif part.kind == "text":
        yield _text(f"{part.label}: {part.text}" if part.label else part.text)


def _bullet(text: str) -> RichTable:
    line = RichTable.grid(padding=(0, 1))
    line.add_row(Text(" -"), _text(text))
    return line


def _title(text: str, style: str = "bold") -> RenderableType:
    return _apart(Text(visible(text), style=style))


def _apart(piece: RenderableType) -> Padding:
    """Return a part with a blank line before it."""
    return Padding(piece, (1, 0, 0, 0))


def _text(text: str) -> Text:
    return TiedText(with_signs(visible(text)))


GAP = 3
"""Characters between two columns of a table."""
LONGEST_WORD = 20
"""Longest word of a wrapping column that is kept on one line. Project choice: paths and parameter lists may break."""


@dataclass(frozen=True, slots=True)
class _Grid:
    """A table that is laid out when the width of its place is known."""

    table: Table

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        yield _grid(self.table, options.max_width)


def _fit(lines: RichTable, width: int) -> None:
    """Break the longest name of a table that is too wide. It would lose the end of every line."""
    least = [column.min_width or 0 for column in lines.columns]
    over = sum(least) + GAP * (len(least) - 1) - width
    names = [column for column in lines.columns if column.justify == "left"]
    if over <= 0 or not names:
        return
    longest = max(names, key=lambda column: column.min_width or 0)
    for column in lines.columns:
        column.width = column.min_width
    longest.width, longest.no_wrap = max((longest.min_width or 0) - over, 1), False
    longest.min_width = longest.width


def _grid(table: Table, width: int) -> Padding:
    """Return a table for *width* characters, without its empty and wide columns, and without the rows that the page
    folds.
    """
    is_headed = any(table.heads)
    lines = RichTable(box=box.SIMPLE, pad_edge=False, show_edge=False, header_style="bold", show_header=is_headed)
    rows = [tuple(with_signs(visible(cell)) for cell in row) for row in table.rows[: table.shown]]
    used = [i for i in table.filled(rows) if table.heads[i] not in table.wide]
    for i in used:
        right = table.align[i] == "r"
        head = Text(with_signs(visible(table.heads[i])))
        widths = [cell_len(word) for word in head.plain.split()]
        # A head may wrap between its words, but a number or a name that is cut cannot be read or typed.
        if right or not any(" " in row[i] for row in rows):
            widths += [cell_len(row[i]) for row in rows]
        else:
            widths += [cell_len(word) for row in rows for word in row[i].split() if cell_len(word) <= LONGEST_WORD]
        least = max(widths, default=0)
        # The width is taken from the columns that may wrap, so those that cannot must not be among them.
        whole = least >= max(cell_len(text) for text in (head.plain, *(row[i] for row in rows)))
        lines.add_column(head, justify="right" if right else "left", no_wrap=whole, min_width=least, overflow="fold")
    _fit(lines, width)
    for row in rows:
        lines.add_row(*(TiedText(row[i]) for i in used))
    return _apart(Group(lines, _apart(_text(table.note))) if table.note else lines)
