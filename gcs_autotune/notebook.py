"""Display of results in a notebook: tables as HTML, and pandas if it is installed."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape
from typing import Any

from gcs_autotune.errors import UsageError
from gcs_autotune.untrusted_text import visible

__all__ = ["html_block", "html_table", "pandas_module"]


def pandas_module() -> Any:
    """Return pandas, imported on first use. Nothing else here needs it.

    Raises
    ------
    UsageError
        It is not installed.
    """
    try:
        import pandas
    except ImportError as error:
        raise UsageError(f"this needs pandas, which is not installed. Run pip install pandas ({error})") from None
    return pandas


def html_table(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return an HTML table.

    The first column is text, the others are numbers. Every cell is escaped, because it may come from a file.
    """

    def cells(tag: str, row: Sequence[str]) -> str:
        side = ("left", *["right"] * (len(row) - 1))
        return "".join(
            f'<{tag} style="text-align:{where}">{escape(visible(str(cell)))}</{tag}>'
            for where, cell in zip(side, row, strict=True)
        )

    body = "".join(f"<tr>{cells('td', row)}</tr>" for row in rows)
    return f"<table><thead><tr>{cells('th', heads)}</tr></thead><tbody>{body}</tbody></table>"


def html_block(title: str, tables: Sequence[str], remarks: Iterable[str] = ()) -> str:
    """Return HTML with a heading, tables made by :func:`html_table`, and sentences as a list."""
    points = "".join(f"<li>{escape(visible(remark))}</li>" for remark in remarks)
    return f"<div><b>{escape(visible(title))}</b>{''.join(tables)}{f'<ul>{points}</ul>' if points else ''}</div>"
