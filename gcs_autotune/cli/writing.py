"""Where results are written: reports to standard output, results to files.

Replacing files of an earlier run is reported.
"""

from __future__ import annotations

import itertools
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from gcs_autotune.errors import BadFile
from gcs_autotune.plain_json import json_text
from gcs_autotune.untrusted_text import visible

if TYPE_CHECKING:
    from gcs_autotune.report import Document

__all__ = ["fresh", "on_replacing", "put_out", "write_page"]


def fresh(path: Path) -> Path:
    """Return *path*, or if it exists, the first unused one of ``NAME-2``, ``NAME-3``, ...

    It is for names that a command chooses. A file named by the user is overwritten, and the command reports this.
    """
    later = (path.with_name(f"{path.stem}-{k}{path.suffix}") for k in itertools.count(2))
    return next(p for p in itertools.chain([path], later) if not p.exists())


def on_replacing(path: Path) -> str:
    """Return a note that *path* replaces an earlier file, for the line that shows *path*; empty if no file is replaced.
    Call before writing.
    """
    is_there = any(path.iterdir()) if path.is_dir() else path.exists()
    return " (replaced an earlier file)" if is_there else ""


def write_page(document: Document, path: Path) -> str:
    """Write a report as a page and return the line that shows *path*.

    Raises
    ------
    BadFile
        The file cannot be written.
    """
    from gcs_autotune.report import to_html

    replaced = on_replacing(path)
    try:
        path.write_text(to_html(document), encoding="utf-8")
    except OSError as error:
        raise BadFile(f"{path} cannot be written: {error.strerror}") from error
    return f"Report: {path}{replaced}"


def put_out(document: Document, *lines: str, as_json: bool = False) -> None:
    """Print a report on standard output, as JSON or as text. Text is followed by *lines*, such as its file."""
    from gcs_autotune.report import print_document, to_json

    if as_json:
        sys.stdout.write(json_text(to_json(document)))
        return
    from rich.console import Console
    from rich.text import Text

    console = Console()
    print_document(console, document)
    if lines:
        console.print(Text("\n" + "\n".join(visible(line) for line in lines)), soft_wrap=True)
