"""Display of results: as a table in a notebook, as text by ``print``, and as a DataFrame if pandas is installed."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass
from html import escape
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.errors import UsageError
from gcs_autotune.rounding import format_number, format_value
from gcs_autotune.untrusted_text import visible

__all__ = [
    "Display",
    "Displayed",
    "Table",
    "display_of_fields",
    "display_of_fit",
    "in_python",
    "pandas_module",
    "parameter_tables",
]

WIDTH, NARROWEST = 88, 24
"""Columns of the printed text, as in most notebooks, and of its narrowest wrapped column. Project choices."""

MOST_VALUES, MOST_ROWS = 6, 20
"""Values of a list that are printed, and rows of a table of parts; longer ones are only counted. Project choices."""

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


_STATUS: Mapping[str, str] = {"absent": "not fitted", "fixed": "known", "at_bound": "at its bound, not reliable"}
"""Status of a parameter -> words; others are shown unchanged."""


def parameter_tables(parameters: Mapping[str, Any], covariance: NDArray[np.float64]) -> tuple[Table, ...]:
    """Return the table of fitted *parameters* with their relative errors, and that of large correlations.

    parameters : name -> value with ``value``, ``std``, ``unit`` and ``status``. covariance : (p, p), in this order.
    """
    rows = []
    for name, p in parameters.items():
        percent = 100.0 * p.std / abs(p.value) if p.std > 0.0 and p.value else 0.0
        share = "" if not percent else f"{percent:.1f} %" if percent >= 0.05 else "< 0.1 %"
        rows.append((name, format_value(p.value, p.std), share, p.unit, _STATUS.get(p.status, p.status)))
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


def display_of_fields(result: Any) -> Display:
    """Return what a dataclass or named tuple shows unless it defines more: one row per number, text or part.

    Units and meanings are those of its docstring: the text after the field's name and colon, to the first full stop.
    A part shows its own numbers. Parts of one kind are the rows of a further table.
    """
    doc = type(result).__doc__ or ""
    rows: list[tuple[str, str, str]] = []
    tables: list[Table] = []
    for name, value in _fields(result):
        if _is_list_of_parts(value):
            parts = list(value.values()) if isinstance(value, Mapping) else list(value)
            labels = list(map(str, value)) if isinstance(value, Mapping) else [str(i + 1) for i in range(len(parts))]
            if 0 < len(parts) <= MOST_ROWS:
                tables.append(_table_of_parts(name, labels, parts))
                continue
        meaning = _meaning(doc, name)
        named = value.items() if isinstance(value, Mapping) else _fields(value) if _is_part(value) else ()
        inner = [(str(key), _shown(each)) for key, each in named if _is_plain(each)]
        if inner and len(inner) <= MOST_ROWS:
            rows += [(f"{name}.{key}", text, meaning if i == 0 else "") for i, (key, text) in enumerate(inner)]
        else:
            rows.append((name, _shown(value), meaning))
    return Display(f"{type(result).__name__}: {_summary(doc)}", (*_table_of_fields(rows), *tables))


def _table_of_fields(rows: Sequence[tuple[str, str, str]]) -> tuple[Table, ...]:
    """Return the table of (field, value, meaning). A long text is shown in the last column, which wraps."""
    wide = [(n, "", text) if len(text) > NARROWEST and not meaning else (n, text, meaning) for n, text, meaning in rows]
    columns = 3 if any(meaning for *_, meaning in wide) else 2
    return (Table(("field", "value", "meaning")[:columns], tuple(row[:columns] for row in wide)),) if wide else ()


def _summary(doc: str) -> str:
    """Return the first paragraph of a docstring on one line."""
    return " ".join(doc.replace("``", "").strip().partition("\n\n")[0].split()).rstrip(".")


def _fields(result: Any) -> Iterator[tuple[str, Any]]:
    names = [f.name for f in fields(result)] if is_dataclass(result) else getattr(result, "_fields", ())
    return ((name, getattr(result, name)) for name in names if not name.startswith("_"))


def _is_part(value: Any) -> bool:
    return hasattr(type(value), "_fields") or is_dataclass(value)


def _is_plain(value: Any) -> bool:
    return value is None or isinstance(value, (str, bool, int, float, np.number))


def _is_list_of_parts(value: Any) -> bool:
    parts = value.values() if isinstance(value, Mapping) else value
    if not isinstance(value, (Mapping, tuple, list)) or _is_part(value):
        return False
    return bool(value) and all(_is_part(part) for part in parts) and len({type(part) for part in parts}) == 1


def _table_of_parts(name: str, labels: Sequence[str], parts: Sequence[Any]) -> Table:
    """Return one row per part of one kind, with the numbers and texts that every part has."""
    plain = [key for key, _ in _fields(parts[0]) if all(_is_plain(getattr(part, key)) for part in parts)]
    rows = tuple(
        (label, *(_shown(getattr(part, key)) for key in plain)) for label, part in zip(labels, parts, strict=True)
    )
    return Table((name, *plain), rows)


def _shown(value: Any) -> str:
    """Return *value* as the text of one cell. Long lists and arrays are counted."""
    if value is None:
        return "none"
    if isinstance(value, (bool, np.bool_)):
        return "yes" if value else "no"
    if isinstance(value, (int, float, np.integer, np.floating)):
        return format_number(float(value))
    if isinstance(value, np.ndarray):
        few = value.ndim == 1 and value.size <= MOST_VALUES
        return ", ".join(map(_shown, value)) if few else f"array {value.shape}"
    if isinstance(value, Mapping) or (isinstance(value, (tuple, list, set, frozenset)) and not _is_part(value)):
        few = len(value) <= MOST_VALUES and not isinstance(value, Mapping) and all(map(_is_plain, value))
        return ", ".join(map(_shown, value)) if few and value else f"{len(value)} entries" if value else "none"
    return str(value) if isinstance(value, (str, np.generic)) else type(value).__name__


def _meaning(doc: str, name: str) -> str:
    """Return unit and meaning of the field *name* in the docstring *doc*, or an empty text."""
    found = re.search(rf"``{name}``(?:, ``\w+``)*(?: (\[[^\]]+\]))?: ((?:[^.;]|\.(?=\S))+)", doc)
    return "" if found is None else " ".join(f"{found[1] or ''} {found[2]}".replace("``", "").split())


class Displayed:
    """A result that shows itself: ``print`` gives text, and a notebook gives a table.

    It shows its fields (:func:`display_of_fields`), unless its class defines what it shows.
    """

    __slots__ = ()

    def _display(self) -> Display:
        return display_of_fields(self)

    def __str__(self) -> str:
        return self._display().text

    def _repr_html_(self) -> str:
        return self._display().html
