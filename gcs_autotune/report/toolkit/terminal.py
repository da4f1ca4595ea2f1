"""Parts of the terminal output: legible without colour, at 80 columns, and through a pipe.

Each function returns a renderable for a ``rich`` console; nothing here prints.
"""

from __future__ import annotations

import io
from collections.abc import Iterable

from rich import box
from rich.console import Console, Group, RenderableType
from rich.padding import Padding
from rich.table import Table as RichTable
from rich.text import Text

from gcs_autotune.report.toolkit.page import Table
from gcs_autotune.report.toolkit.wording import Tone
from gcs_autotune.untrusted_text import visible

__all__ = ["STYLES", "bullet", "contradictions_shown", "doubts_shown", "grid", "paragraph", "render_text", "title"]


STYLES: dict[Tone, str] = {"good": "bold green", "neutral": "bold", "bad": "bold red"}
"""Tone of a verdict -> terminal style."""


def render_text(thing: RenderableType, width: int = 80) -> str:
    """Return *thing* as plain text, as in a pipe: no colour, no trailing blanks."""
    console = Console(file=io.StringIO(), width=width, color_system=None, force_terminal=False, legacy_windows=False)
    with console.capture() as capture:
        console.print(thing)
    return "\n".join(line.rstrip() for line in capture.get().rstrip().splitlines()) + "\n"


def doubts_shown(texts: Iterable[str], about: str = "fit") -> list[RenderableType]:
    """Return the block of doubts *about* a result, or the sentence that there are none."""
    found = list(texts)
    if not found:
        return [paragraph(f"No doubts about the {about}.")]
    heading = "Doubts" if about == "fit" else f"Doubts about the {about}"
    return [title(heading, "bold yellow"), *(bullet(text) for text in found)]


def contradictions_shown(texts: Iterable[str]) -> list[RenderableType]:
    """Return the block at the head of a result whose columns contradict each other; empty if none do."""
    found = list(texts)
    if not found:
        return []
    return [title("Columns that contradict each other", STYLES["bad"]), *(bullet(text) for text in found)]


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


def grid(table: Table) -> Padding:
    """Return a table without its empty columns."""
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
