"""Ship figures for the terminal: one table a manoeuvre, the criterion beside what was measured."""

from __future__ import annotations

import math
from collections.abc import Sequence

from rich.console import Group, RenderableType

from gcs_autotune.report.numbers import UNKNOWN, format_number, format_value, pretty_unit, to_people
from gcs_autotune.report.tables import Table
from gcs_autotune.report.terminal import doubts_shown, grid, paragraph, title
from gcs_autotune.report.wording import doubt_sentence
from gcs_autotune.seatrials import Figure, Sheet

__all__ = ["sheet_table", "sheets_summary"]

_VERDICTS = {"meets": "met", "fails": "FAILED", "open": "too close"}


def sheets_summary(sheets: Sequence[Sheet]) -> Group:
    """Return what ``figures`` shows: per manoeuvre its figures, the verdict, what to doubt."""
    parts: list[RenderableType] = []
    for sheet in sheets:
        parts.extend((title(f"{sheet.run}: {sheet.title}"), grid(sheet_table(sheet))))
        if sheet.verdict:
            parts.append(paragraph(f"{sheet.verdict[0].upper()}{sheet.verdict[1:]}."))
        if sheet.doubts:
            parts.extend(doubts_shown(doubt_sentence(d) for d in sheet.doubts))
    return Group(*parts)


def sheet_table(sheet: Sheet) -> Table:
    """Figures with their standard errors, the IMO criterion and whether it is met."""
    return Table(("figure", "value ± std", "unit", "IMO limit", ""), "lrlrl", tuple(_row(f) for f in sheet.figures))


def _row(figure: Figure) -> tuple[str, ...]:
    reading = figure.reading
    unit, factor = to_people(reading.unit)
    value = reading.value * factor
    shown = format_value(value, reading.std * factor) if math.isfinite(reading.std) else format_number(value)
    if reading.std == 0.0:
        shown = format_number(value)
    if figure.limit is None:
        return figure.name, shown or UNKNOWN, pretty_unit(unit), "", ""
    return figure.name, shown, pretty_unit(unit), format_number(figure.limit.value * factor), _VERDICTS[figure.verdict]
