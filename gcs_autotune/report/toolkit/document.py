"""The model of every report: a verdict, and sections of notes, tables and figures.

A report is built once, from functions that return a section each, and shown three times: as a page
(:func:`.page.to_html`), on the terminal (:func:`.terminal.to_terminal`) and as data (:func:`.data.to_json`).
Everything here is frozen and plain; a figure is drawn only for the page. A part without text, row or part of its own
is left out, so that a section can list what it may have.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Literal

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Drawing

__all__ = [
    "IN_RESULT",
    "Document",
    "Figure",
    "KeyFigure",
    "Note",
    "Part",
    "Section",
    "Table",
    "Tone",
    "Verdict",
    "bullets",
    "is_empty",
    "notes",
]

Tone = Literal["good", "neutral", "bad"]
"""Colour of a verdict: good news, neither, or a reason to be careful."""

IN_RESULT: Mapping[str, Any] = MappingProxyType({})
"""``Section.facts`` of a section whose numbers the document's own facts contain."""


@dataclass(frozen=True, slots=True)
class Verdict:
    """The result in one sentence, its tone, and the sentences that follow it."""

    text: str
    tone: Tone
    sentences: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class KeyFigure:
    """A number of the page's first row, with its label and a remark."""

    number: str
    label: str
    remark: str = ""


@dataclass(frozen=True, slots=True)
class Note:
    """A sentence or paragraph, with a bold ``label`` if it has one.

    kind : ``text``; ``bullet`` of a list; ``command`` to copy, with *label* as its introduction; ``quiet``: how to
    read what stands above. detail : whether the terminal leaves it out, as it does every quiet note.
    """

    text: str
    label: str = ""
    kind: Literal["text", "bullet", "command", "quiet"] = "text"
    detail: bool = False


@dataclass(frozen=True, slots=True)
class Table:
    """Rows of text under heads.

    align : one letter a column, ``l`` text or ``r`` number. note : a sentence below it that holds for all rows.
    shown : rows shown at first, None for all; the terminal has only these, the page folds the rest under *fold*.
    wide : heads of columns that 80 characters have no space for. detail : whether the terminal leaves it out.
    """

    heads: tuple[str, ...]
    align: str
    rows: tuple[tuple[str, ...], ...]
    note: str = ""
    shown: int | None = None
    fold: str = ""
    wide: tuple[str, ...] = ()
    detail: bool = False


@dataclass(frozen=True, slots=True)
class Figure:
    """A figure of the page.

    name : unique on the page. draw : returns the matplotlib figure, or None if there is nothing to plot.
    """

    name: str
    caption: str
    draw: Callable[[], Drawing | None]


@dataclass(frozen=True, slots=True)
class Section:
    """A heading and what stands under it, in order; a section inside a section has a smaller heading.

    slug : unique in the document; the page's anchor, and the key in JSON. detail : whether the terminal leaves it out.
    facts : what JSON has of it, None for its text under its slug; :data:`IN_RESULT` for nothing more.
    """

    slug: str
    title: str
    parts: tuple[Part, ...]
    detail: bool = False
    facts: Mapping[str, Any] | None = None


Part = Note | Table | Figure | Section


@dataclass(frozen=True, slots=True)
class Document:
    """A report.

    title : its heading on the page. when : the moment, formatted. about : further words beside it; badge : one that is
    set off. verdict : None for a list that judges nothing. lead : the result in plain words, before the verdict, with
    *lead_figures*. contradictions : what is wrong with the data themselves, before everything else. doubts : sentences
    with their cures, None if doubts do not apply; doubted : their subject. facts : the JSON form without the sections.
    """

    title: str
    sections: tuple[Section, ...]
    verdict: Verdict | None = None
    when: str = ""
    about: tuple[str, ...] = ()
    badge: str = ""
    lead: str = ""
    lead_figures: tuple[Figure, ...] = ()
    key_figures: tuple[KeyFigure, ...] = ()
    contradictions: tuple[str, ...] = ()
    doubts: tuple[str, ...] | None = None
    doubted: str = "fit"
    facts: Mapping[str, Any] = field(default_factory=dict)


def is_empty(part: Part) -> bool:
    """Return whether there is nothing to show: no text, no row, no part; every renderer leaves it out."""
    if isinstance(part, Note):
        return not part.text
    if isinstance(part, Table):
        return not part.rows
    return isinstance(part, Section) and all(map(is_empty, part.parts))


def notes(texts: tuple[str, ...]) -> Iterator[Note]:
    """Yield a note per sentence."""
    return (Note(text) for text in texts)


def bullets(texts: tuple[str, ...]) -> Iterator[Note]:
    """Yield a bullet per sentence."""
    return (Note(text, kind="bullet") for text in texts)
