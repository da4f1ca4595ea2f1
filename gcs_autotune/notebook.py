"""Display of results: as a table in a notebook, as text by ``print``, and as a DataFrame if pandas is installed."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.errors import UsageError
from gcs_autotune.rounding import format_value
from gcs_autotune.untrusted_text import visible

__all__ = ["Display", "Displayed", "Table", "display_of_fit", "in_python", "pandas_module", "parameter_tables"]

WIDTH, NARROWEST = 88, 24
"""Columns of the printed text, as in most notebooks, and of its narrowest wrapped column. Project choices."""

CORRELATED = 0.5
"""Correlation of two parameters from which it is shown. Project choice."""

ARGUMENTS: Mapping[str, str] = {
    "--robust": 'loss="soft_l1"',
    "--validate": "unseen=",
    "--system-id": "system=",
}
"""Option of a command -> argument of ``gcs_autotune.api``, if the argument is not the name of the option."""


def in_python(sentence: str) -> str:
    """Return a *sentence* of the terminal with options as Python arguments: ``--full-scale`` becomes ``full_scale=``.

    Commands in backticks remain as they are.
    """

    def argument(match: re.Match[str]) -> str:
        option = match.group(0)
        return ARGUMENTS.get(option, option.removeprefix("--").replace("-", "_") + "=")

    parts = re.split("(`[^`]*`)", sentence)
    return "".join(p if p.startswith("`") else re.sub(r"(?<![\w-])--[a-z][a-z0-9-]*", argument, p) for p in parts)


def pandas_module() -> Any:
    """Return pandas, imported on first use. Nothing else here needs it.

    Raises
    ------
    UsageError
        pandas is not installed.
    """
    try:
        import pandas
    except ImportError as error:
        raise UsageError(f"this needs pandas, which is not installed. Run pip install pandas ({error})") from None
    return pandas


@dataclass(frozen=True, slots=True)
class Table:
    """A table: the first column is text, the others are numbers. Its cells may come from a file."""

    heads: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]

    @property
    def html(self) -> str:
        """The table as HTML, every cell escaped."""
        body = "".join(f"<tr>{self._cells('td', row)}</tr>" for row in self.rows)
        return f"<table><thead><tr>{self._cells('th', self.heads)}</tr></thead><tbody>{body}</tbody></table>"

    def _cells(self, tag: str, row: Sequence[str]) -> str:
        side = ("left", *["right"] * (len(row) - 1))
        return "".join(
            f'<{tag} style="text-align:{where}">{escape(visible(str(cell)))}</{tag}>'
            for where, cell in zip(side, row, strict=True)
        )

    @property
    def text(self) -> str:
        """The table as lines of text with aligned columns. A last column that is too wide is wrapped."""
        rows = [tuple(visible(str(cell)) for cell in row) for row in (self.heads, *self.rows)]
        *widths, last = (max(map(len, column)) for column in zip(*rows, strict=True))
        indent = 2 + sum(width + 2 for width in widths)
        lines: list[str] = []
        for row in rows:
            first, *rest = textwrap.wrap(row[-1], max(min(last, WIDTH - indent), NARROWEST)) or [""]
            cells = (*(c.ljust(w) for c, w in zip(row, widths, strict=False)), first)
            lines += ["  " + "  ".join(cells).rstrip(), *(indent * " " + each for each in rest)]
        return "\n".join(lines)


@dataclass(frozen=True, slots=True)
class Display:
    """What a result shows of itself: a heading, tables that are not empty, and remarks."""

    title: str
    tables: tuple[Table, ...]
    remarks: tuple[str, ...] = ()

    @property
    def html(self) -> str:
        """The display as HTML, with the remarks as a list."""
        tables = "".join(table.html for table in self.tables)
        points = "".join(f"<li>{escape(visible(in_python(remark)))}</li>" for remark in self.remarks)
        return f"<div><b>{escape(visible(self.title))}</b>{tables}{f'<ul>{points}</ul>' if points else ''}</div>"

    @property
    def text(self) -> str:
        """The display as text of at most :data:`WIDTH` columns, if the tables are narrower."""
        remarks = [
            textwrap.fill(visible(in_python(r)), WIDTH, initial_indent="  - ", subsequent_indent="    ")
            for r in self.remarks
        ]
        parts = [textwrap.fill(visible(self.title), WIDTH), *(t.text for t in self.tables), "\n".join(remarks)]
        return "\n\n".join(part for part in parts if part)


def parameter_tables(parameters: Mapping[str, Any], covariance: NDArray[np.float64]) -> tuple[Table, ...]:
    """Return the table of fitted *parameters* with their relative errors, and that of large correlations.

    parameters : name -> value with ``value``, ``std``, ``unit`` and ``status``. covariance : (p, p), in this order.
    """
    rows = []
    for name, p in parameters.items():
        share = f"{100.0 * p.std / abs(p.value):.1f} %" if p.std > 0.0 and p.value else ""
        rows.append((name, format_value(p.value, p.std), share, p.unit, p.status))
    names, std = list(parameters), np.sqrt(np.maximum(np.diag(covariance), 0.0))
    scale = np.where(std > 0.0, std, np.inf)
    correlation = covariance / np.outer(scale, scale)
    correlated = [
        (f"{names[i]}, {names[j]}", f"{correlation[i, j]:+.2f}")
        for i, j in zip(*np.triu_indices(len(names), 1), strict=True)
        if abs(correlation[i, j]) >= CORRELATED
    ]
    heads = ("parameter", "value ± standard error", "relative", "unit", "status")
    return Table(heads, tuple(rows)), Table(("parameters", "correlation"), tuple(correlated))


def display_of_fit(
    title: str, parameters: Mapping[str, Any], covariance: NDArray[np.float64], doubts: Iterable[Any]
) -> Display:
    """Return what ``print`` shows of a fit: :func:`parameter_tables`, and cause and cure of its *doubts*."""
    tables = parameter_tables(parameters, covariance)
    return Display(title, tuple(t for t in tables if t.rows), tuple(f"{d.cause}. Cure: {d.cure}" for d in doubts))


class Displayed:
    """A result that shows itself: ``print`` gives text, and a notebook gives a table."""

    __slots__ = ()

    def _display(self) -> Display:
        raise NotImplementedError

    def __str__(self) -> str:
        return self._display().text

    def _repr_html_(self) -> str:
        return self._display().html
