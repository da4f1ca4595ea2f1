"""Text for the terminal whose lines never break between a number and its unit."""

from __future__ import annotations

from typing import Any

from rich.console import Console, ConsoleOptions
from rich.containers import Lines
from rich.measure import Measurement
from rich.text import Text

from gcs_autotune.report.toolkit.wording import BEFORE_UNIT

__all__ = ["TiedText"]

TIE = "\ue000"
"""Character of one column in place of the blank before a unit, because ``rich`` breaks a line at every blank."""


class TiedText(Text):
    """Text that wraps between words, but not before the unit of a number.

    Print it within a ``Group`` or a table: ``Console.print`` joins plain texts to one of its own class.
    """

    def wrap(self, console: Console, width: int, **options: Any) -> Lines:
        """Return the lines of the text."""
        lines = Text.wrap(self._tied(), console, width, **options)
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
