"""Templates filled in: every page this tool writes is made here, of tables and pictures."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined, select_autoescape
from markupsafe import Markup

from gcs_autotune.report.toolkit.wording import sentence
from gcs_autotune.untrusted_text import visible

__all__ = ["Picture", "Table", "render_page"]


@dataclass(frozen=True, slots=True)
class Table:
    """Rows of text under heads; ``align`` has one letter a column, ``l`` text or ``r`` number. ``note``: a sentence for
    under it, of what holds for all rows."""

    heads: tuple[str, ...]
    align: str
    rows: tuple[tuple[str, ...], ...]
    note: str = ""


@dataclass(frozen=True, slots=True)
class Picture:
    """A figure ready for the page."""

    kind: str
    caption: str
    svg: Markup


PHONE = 42
"""Characters of a table's row that a telephone 390 pixels wide shows."""

LEGIBLE = 14
"""Characters below which a column of sentences is a column of single words."""


def render_page(template: str, context: Mapping[str, Any]) -> str:
    """Return the page; the same context gives the same bytes."""
    environment = Environment(
        loader=PackageLoader("gcs_autotune.report", ""),
        autoescape=select_autoescape(["html"]),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["glued"] = _glued
    environment.filters["sentence"] = sentence
    environment.filters["wide"] = _is_wide
    return visible(environment.get_template(template).render(context), keep="\n\t\u00ad") + "\n"


def _is_wide(table: Table) -> bool:
    """Whether a table is wider than a phone: there its rows are shown one below the other."""
    columns = [[head, *(row[i] for row in table.rows)] for i, head in enumerate(table.heads)]
    return sum(_least_width(cells, a) for cells, a in zip(columns, table.align, strict=True)) > PHONE


def _least_width(cells: Sequence[str], align: str) -> int:
    """Return the characters a column needs: numbers stand in one line, text breaks between words but is still read."""
    if align == "r":
        return 2 + max(map(len, cells))
    longest = max((len(word) for cell in cells for word in cell.split()), default=0)
    return 2 + max(longest, min(LEGIBLE, max(map(len, cells))))


def _glued(text: str) -> str:
    """Keep a number and its unit on one line."""
    return re.sub(r"(?<=\d) (?=%|(?:s|m|dB|Hz)\b)", "\u00a0", text)
