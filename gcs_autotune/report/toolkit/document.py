"""The model of every report: a verdict, and sections of notes, tables and figures.

A report is built once, from functions that each return a section. It can be shown in three ways: as a page
(:func:`.page.to_html`), on the terminal (:func:`.terminal.to_terminal`) and as data (:func:`.data.to_json`). All
classes here are frozen and contain plain data. A figure is plotted only for the page. A part without content is left
out, so a section can list optional parts.
"""

from __future__ import annotations

import shlex
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Literal, TypeVar

from gcs_autotune.identify import Grade

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
    "files_section",
    "is_empty",
    "notes",
    "resume_section",
]

Tone = Literal["good", "neutral", "bad"]
"""Colour of a verdict: good, neutral, or a reason for caution."""

IN_RESULT: Mapping[str, Any] = MappingProxyType({})
"""Value of ``Section.facts`` for a section whose numbers are already in the document's own facts."""


@dataclass(frozen=True, slots=True)
class Verdict:
    """The result in one sentence, its tone, and the sentences that follow."""

    text: str
    tone: Tone
    sentences: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class KeyFigure:
    """A main result in the first row of the page: its value, label and remark."""

    number: str
    label: str
    remark: str = ""


@dataclass(frozen=True, slots=True)
class Note:
    """A sentence or paragraph, with a bold ``label`` if it has one.

    kind : ``text``; ``bullet`` of a list; ``command`` to copy, with *label* as its introduction;
        ``quiet``: explanation of the table or figure above.
    detail : whether the terminal leaves it out. The terminal always leaves out quiet notes.
    file : for a bullet: file beside the page to which the page links; empty for no link.
    """

    text: str
    label: str = ""
    kind: Literal["text", "bullet", "command", "quiet"] = "text"
    detail: bool = False
    file: str = ""


@dataclass(frozen=True, slots=True)
class Table:
    """A table: rows of text with column headings.

    align : one letter per column, ``l`` text or ``r`` number. note : a sentence below it that holds for all rows.
    shown : rows shown at first, None for all; the terminal has only these rows; the page folds the others under *fold*.
    wide : headings of the columns left out on a terminal of 80 characters. detail : whether the terminal leaves it out.
    """

    heads: tuple[str, ...]
    align: str
    rows: tuple[tuple[str, ...], ...]
    note: str = ""
    shown: int | None = None
    fold: str = ""
    wide: tuple[str, ...] = ()
    detail: bool = False

    def filled(self, rows: Sequence[tuple[str, ...]]) -> list[int]:
        """Return the columns that are not empty in *rows*; all if there are no rows."""
        return [i for i in range(len(self.heads)) if not rows or any(row[i] for row in rows)]


@dataclass(frozen=True, slots=True)
class Figure:
    """A figure of the page: an interactive chart on the screen, and SVG on paper and without scripts.

    name : unique on the page. draw : returns the matplotlib figure, or None if there is nothing to plot.
    """

    name: str
    caption: str
    draw: Callable[[], Drawing | None]


@dataclass(frozen=True, slots=True)
class Section:
    """A heading with its notes, tables, figures and nested sections, in order. A nested section has a smaller heading.

    slug : unique in the document; it is the page's anchor, and the key in JSON. detail : whether the terminal leaves it
    out. folded : whether the page shows only its title until the reader opens it.
    facts : its JSON form; None: its text under its slug; :data:`IN_RESULT`: nothing in addition.
    """

    slug: str
    title: str
    parts: tuple[Part, ...]
    detail: bool = False
    facts: Mapping[str, Any] | None = None
    folded: bool = False


Part = Note | Table | Figure | Section


@dataclass(frozen=True, slots=True)
class Remark:
    """A doubt and its remedy as text, with its grade."""

    text: str
    grade: Grade = "caution"


GRADES: Mapping[Grade, str] = {"distrust": "Do not trust", "caution": "Caution", "note": "Note"}
"""Grade of a doubt -> its word, the gravest first."""


def cautions(texts: Iterable[str]) -> tuple[Remark, ...]:
    """Return each of the sentences as a caution."""
    return tuple(Remark(text) for text in texts)


@dataclass(frozen=True, slots=True)
class Document:
    """A report as data, which a renderer can show in several ways.

    title : its heading on the page.
    when : date and time as text.
    about : further words next to the date; badge : a highlighted word.
    verdict : None for a list without a verdict.
    lead : the result in plain words, before the verdict, with *lead_figures*.
    contradictions : inconsistencies in the data, shown first.
    doubts : doubts with their remedies; None if doubts do not apply. doubted : subject of the doubts.
    facts : the JSON form without the sections.
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
    doubts: tuple[Remark, ...] | None = None
    doubted: str = "fit"
    facts: Mapping[str, Any] = field(default_factory=dict)

    @property
    def is_doubtful(self) -> bool:
        """Whether the page begins with the doubts: one of them is grave, or the result is not good."""
        is_good = self.verdict is not None and self.verdict.tone == "good"
        return bool(self.doubts) and (not is_good or any(doubt.grade == "distrust" for doubt in self.doubts or ()))

    @property
    def graded(self) -> tuple[tuple[str, Remark], ...]:
        """The doubts with the words of their grades, the gravest first."""
        return tuple((word, d) for grade, word in GRADES.items() for d in self.doubts or () if d.grade == grade)


def is_empty(part: Part) -> bool:
    """Return whether there is nothing to show: no text, row or section. Every renderer then leaves it out."""
    if isinstance(part, Note):
        return not part.text
    if isinstance(part, Table):
        return not part.rows
    return isinstance(part, Section) and all(map(is_empty, part.parts))


Made = TypeVar("Made")
Maker = Callable[[Made], Iterator[Section]]


def sections_of(front: Iterable[Maker[Made]], folded: Iterable[Maker[Made]], of: Made) -> tuple[Section, ...]:
    """Return the sections that *front* makes of the subject *of*, then those of *folded*, folded on the page."""
    rest = (replace(section, folded=True) for make in folded for section in make(of))
    return (*(section for make in front for section in make(of)), *rest)


def notes(texts: tuple[str, ...]) -> Iterator[Note]:
    """Yield each of the sentences as a note."""
    return (Note(text) for text in texts)


def resume_section(command: str, text: str) -> Section:
    """Return the section with the *command* that continues an interrupted run, and the *text* before it.

    ``summary.json`` contains both, so that the list of runs shows them too.
    """
    how = Note(command, text, kind="command")
    return Section("resume", "How to continue", (how,), facts={"resume": {"text": text, "command": command}})


def files_section(directory: str, files: Iterable[str], title: str = "Files of this run") -> Iterator[Section]:
    """Yield a folded section with links to the *files*, relative to the page; *directory*: that of the run, to share
    it.
    """
    links = tuple(Note(name, kind="bullet", file=name) for name in files)
    share = Note(
        f"gcs-autotune share {shlex.quote(directory)}" if directory else "",
        "To pack them into one file to send to others:",
        kind="command",
    )
    if links:
        yield Section("files", title, (*links, share), detail=True, facts=IN_RESULT, folded=True)


def bullets(texts: tuple[str, ...]) -> Iterator[Note]:
    """Yield each of the sentences as a note in the form of a bullet."""
    return (Note(text, kind="bullet") for text in texts)
