"""Convert a document to a page: one self-contained HTML file for a browser, a phone or paper, which opens offline."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from urllib.parse import quote

from jinja2 import Environment, PackageLoader, StrictUndefined, select_autoescape
from markupsafe import Markup

from gcs_autotune.documents import REPORT_MARK
from gcs_autotune.report.toolkit.canvas import pens, to_svg
from gcs_autotune.report.toolkit.chart import chart_script, to_chart
from gcs_autotune.report.toolkit.document import Document, Figure, Note, Part, Section, Table, is_empty
from gcs_autotune.report.toolkit.wording import glued, with_signs
from gcs_autotune.untrusted_text import visible

__all__ = ["drawn", "to_html"]


@dataclass(frozen=True, slots=True)
class _Drawn:
    """A figure as SVG, and as data of an interactive chart; empty if it has none."""

    caption: str
    svg: Markup
    chart: str = ""


_Blocks = tuple[tuple[str, object], ...]


@dataclass(frozen=True, slots=True)
class _Laid:
    """A section as (kind, content) in order, with figures plotted and bullets collected into lists."""

    slug: str
    title: str
    blocks: _Blocks
    folded: bool = False


FEW = 4
"""Number of columns up to which a table stays a table on a phone if its longest pieces fit. Project choice."""

PHONE = 43
"""Number of characters of a table row that fit on a phone 390 pixels wide. Project choice."""

LEGIBLE = 14
"""Column width [characters] below which sentences would break into single words. Project choice."""


def to_html(document: Document) -> str:
    """Return *document* as the text of an HTML page. The same document always results in the same bytes. Empty figures
    and sections are left out.
    """
    environment = Environment(
        loader=PackageLoader("gcs_autotune.report", ""),
        autoescape=select_autoescape(["html"]),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["glued"] = glued
    environment.filters["cell"] = _cell
    environment.filters["wide"] = _is_wide
    environment.filters["quoted"] = quote
    sections = [laid for section in document.sections if (laid := _laid(section)).blocks]
    page = environment.get_template("toolkit/document.html").render(
        document=document,
        lead_figures=[one for figure in document.lead_figures for one in drawn(figure)],
        sections=[laid for laid in sections if not laid.folded],
        folded=[laid for laid in sections if laid.folded],
        script=lambda: Markup(chart_script()),
        mark=Markup(REPORT_MARK),
    )
    return visible(page, keep="\n\t\u00ad") + "\n"


def _laid(section: Section) -> _Laid:
    return _Laid(section.slug, section.title, tuple(_blocks(section.parts)), section.folded)


def _blocks(parts: Sequence[Part]) -> Iterator[tuple[str, object]]:
    shown = [part for part in parts if not is_empty(part)]
    for is_list, group in groupby(shown, lambda part: isinstance(part, Note) and part.kind == "bullet"):
        if is_list:
            yield "bullets", tuple(group)
            continue
        for part in group:
            if isinstance(part, Note):
                yield part.kind, part
            elif isinstance(part, Table):
                yield "table", _filled(part)
            elif isinstance(part, Figure):
                yield from (("figure", one) for one in drawn(part))
            elif (laid := _laid(part)).blocks:
                yield "section", laid


def _filled(table: Table) -> Table:
    """Return *table* without its empty columns."""
    used = table.filled(table.rows)
    heads, align, *rows = (tuple(line[i] for i in used) for line in (table.heads, table.align, *table.rows))
    return replace(table, heads=heads, align="".join(align), rows=tuple(rows))


def drawn(figure: Figure) -> Iterator[_Drawn]:
    """Yield *figure* as an SVG element and an interactive chart, if there is anything to plot."""
    with pens(figure.name):
        drawing = figure.draw()
        if drawing is not None:
            caption = with_signs(figure.caption)
            yield _Drawn(caption, to_svg(drawing, figure.name, caption), to_chart(drawing))


def _in_cell(text: str) -> str:
    """Return a cell's *text* in the notation of the reports. It may break before its standard error."""
    return glued(text).replace("\u00a0±", " ±")


def _cell(text: str) -> Markup:
    """Return a cell's *text* for HTML. A long name or path may break after ``_`` or ``/``."""
    return Markup("<wbr>").join(_BREAK.split(_in_cell(text)))


_BREAK = re.compile(r"(?<=[_/])(?=[A-Za-z0-9]{4})")
"""Places inside a name or path where a cell may break. No unit has four letters after its stroke."""


def _is_wide(table: Table) -> bool:
    """Return whether a table is wider than a phone, which then shows each row as a block.

    A table of few columns stays a table if it fits, because its rows are there to be compared.
    """
    least = _longest_piece if len(table.heads) <= FEW else _least_width
    columns = [[head, *(row[i] for row in table.rows)] for i, head in enumerate(table.heads)]
    return sum(least(cells, a) for cells, a in zip(columns, table.align, strict=True)) > PHONE


def _longest_piece(cells: Sequence[str], _align: str) -> int:
    """Return the length of the longest piece without a break in a column, and one character of space."""
    words = (word for cell in cells for word in _in_cell(cell).split(" "))
    return 1 + max(len(piece) for word in words for piece in _BREAK.split(word))


def _least_width(cells: Sequence[str], align: str) -> int:
    """Return the width that a column needs [characters]. Numbers stay on one line; text wraps between words."""
    if align == "r":
        return 2 + max(map(len, cells))
    longest = max((len(word) for cell in cells for word in cell.split()), default=0)
    return 2 + max(longest, min(LEGIBLE, max(map(len, cells))))
