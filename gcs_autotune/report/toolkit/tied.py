"""Text for the terminal whose lines never break between a number and its unit."""

from __future__ import annotations

import re
from typing import Any

from rich.cells import cell_len
from rich.console import Console, ConsoleOptions
from rich.containers import Lines
from rich.measure import Measurement
from rich.text import Text

from gcs_autotune.report.toolkit.wording import BEFORE_UNIT

__all__ = ["TiedText"]

TIE = "\ue000"
"""Character of one column in place of the blank before a unit, because ``rich`` breaks a line at every blank."""
_PIECE = re.compile(r"[^-@._/=,]*[-@._/=,]+|[^-@._/=,]+")
"""A piece of a long name, such as ``quadratic-`` of ``quadratic-actuator@N.share``."""


class TiedText(Text):
    """Text that wraps between words, but not before the unit of a number. A name that is wider than the line breaks
    between its pieces.

    Print it within a ``Group`` or a table: ``Console.print`` joins plain texts to one of its own class.
    """

    def wrap(self, console: Console, width: int, **options: Any) -> Lines:
        """Return the lines of the text."""
        tied = self._tied()
        tied.plain = re.sub(r"\S+", lambda word: _in_pieces(word[0], width), tied.plain)
        lines = Text.wrap(tied, console, width, **options)
        for line in lines:
            line.plain = line.plain.replace(TIE, " ")
        return lines

    def __rich_measure__(self, console: Console, options: ConsoleOptions) -> Measurement:
        """Return the widths of the longest word and of the longest line."""
        return Text.__rich_measure__(self._tied(), console, options)

    def _tied(self) -> Text:
        tied = self.copy()
        tied.plain = BEFORE_UNIT.sub(TIE, self.plain)
        return tied


def _in_pieces(name: str, width: int) -> str:
    """Return *name* with line breaks between its pieces where it is wider than *width*."""
    if cell_len(name) <= width:
        return name
    lines = [""]
    for piece in _PIECE.findall(name):
        if lines[-1] and cell_len(lines[-1] + piece) > width:
            lines.append("")
        lines[-1] += piece
    return "\n".join(lines)
