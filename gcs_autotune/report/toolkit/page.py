"""Render the templates: every page of this tool, from tables and figures."""

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
    """Rows of text under heads; ``align`` has one letter a column, ``l`` text or ``r`` number. ``note``: a
    sentence below it that holds for all rows."""

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
"""Characters of a table's row that a phone 390 pixels wide shows."""

LEGIBLE = 14
"""Width in characters below which a column of sentences becomes one of single words. Chosen."""


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
    """Return whether a table is wider than a phone, which then shows each row as a block."""
    columns = [[head, *(row[i] for row in table.rows)] for i, head in enumerate(table.heads)]
    return sum(_least_width(cells, a) for cells, a in zip(columns, table.align, strict=True)) > PHONE


def _least_width(cells: Sequence[str], align: str) -> int:
    """Return the width a column needs [characters]: numbers stay on one line, text wraps between words."""
    if align == "r":
        return 2 + max(map(len, cells))
    longest = max((len(word) for cell in cells for word in cell.split()), default=0)
    return 2 + max(longest, min(LEGIBLE, max(map(len, cells))))


def _glued(text: str) -> str:
    """Keep a number and its unit on one line."""
    return re.sub(r"(?<=\d) (?=%|(?:s|m|dB|Hz)\b)", "\u00a0", text)
