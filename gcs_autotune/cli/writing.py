"""Where results are written: reports to standard output, results to files.

Replacing files of an earlier run is reported.
"""

from __future__ import annotations

import argparse
import codecs
import itertools
import os
import shutil
import sys
import textwrap
from collections.abc import Iterator
from dataclasses import replace
from io import TextIOWrapper
from pathlib import Path
from typing import TYPE_CHECKING, TextIO

from gcs_autotune.documents import is_report
from gcs_autotune.errors import BadFile
from gcs_autotune.plain_json import json_text
from gcs_autotune.untrusted_text import visible

if TYPE_CHECKING:
    from gcs_autotune.report import Document

__all__ = ["folded", "fresh", "in_plain_signs", "on_replacing", "page_file", "put_out", "write_page"]


PLAIN = {"°": " deg", "²": "^2", "±": "+-", "·": "*", "\N{MINUS SIGN}": "-", "→": "->", "…": "...", "\u00a0": " "}
"""Sign -> what stands for it on a terminal without UTF-8."""


def in_plain_signs(*streams: TextIO) -> None:
    """Let each stream without UTF-8 write :data:`PLAIN` for the signs that it lacks, and ``?`` for others."""
    codecs.register_error("plain-signs", _plain)
    for stream in streams:
        if isinstance(stream, TextIOWrapper) and not stream.encoding.lower().startswith("utf"):
            stream.reconfigure(errors="plain-signs")


def _plain(error: UnicodeError) -> tuple[str, int]:
    assert isinstance(error, UnicodeEncodeError)
    return "".join(PLAIN.get(sign, "?") for sign in error.object[error.start : error.end]), error.end


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


def page_file(text: str) -> Path:
    """Return the path of a page to write, as the type of the option ``--page``.

    An earlier report is replaced. Another file or a folder is not: in ``figures --page RUN`` the option takes the run.

    Raises
    ------
    argparse.ArgumentTypeError
        The path is that of a folder, or of a file that is not a report of this program, or that cannot be read.
    """
    path = Path(text)
    if path.exists() and not _is_replaceable(path):
        raise argparse.ArgumentTypeError(
            f"{text} exists and is not a report of this program. Name another file after --page, such as report.html"
        )
    return path


def _is_replaceable(path: Path) -> bool:
    try:
        return path.is_file() and (not path.stat().st_size or is_report(path))
    except OSError:
        return False


def write_page(document: Document, path: Path, *sources: Path | None) -> str:
    """Write a report as a page with links to its *sources*, and return the line that shows *path*.

    sources : files and run directories that the report stands on, and files written with it.

    Raises
    ------
    BadFile
        The file cannot be written.
    """
    from gcs_autotune.report import files_section, to_html

    replaced = on_replacing(path)
    files = dict.fromkeys(file.resolve() for source in sources if source for file in _linked(source))
    names = (Path(os.path.relpath(file, path.parent.resolve())).as_posix() for file in files if file != path.resolve())
    links = files_section("", names, "Files of this report")
    document = replace(document, sections=(*document.sections, *links))
    try:
        path.write_text(to_html(document), encoding="utf-8")
    except OSError as error:
        raise BadFile(f"{path} cannot be written: {error.strerror}") from error
    return f"Report: {path}{replaced}"


def _linked(source: Path) -> Iterator[Path]:
    """Yield a source of a report; of a directory its report, model and tables, because a server lists no directory."""
    if not source.is_dir():
        yield source
        return
    for pattern in ("*.html", "*.json", "*.csv", "trials/*.csv"):
        yield from sorted(source.glob(pattern))


def folded(text: str, stream: TextIO, indent: str = "") -> str:
    """Return *text* as lines for *stream*, folded between words if it is a terminal. *indent* is that of the lines
    after the first.
    """
    if stream.isatty():
        width = shutil.get_terminal_size().columns
        text = textwrap.fill(text, width, subsequent_indent=indent, break_long_words=False, break_on_hyphens=False)
    return f"{text}\n"


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
