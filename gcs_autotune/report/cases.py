"""The report of a study: how many cases succeeded, where, and the worst of them."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from typing import TYPE_CHECKING

from gcs_autotune.report.toolkit.document import IN_RESULT, Document, Figure, KeyFigure, Note, Section, Table, Verdict

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as Drawing
    from matplotlib.image import AxesImage

__all__ = [
    "BOUND_CLASSES",
    "BoundCheck",
    "CaseStudy",
    "Confusion",
    "Rate",
    "Spread",
    "StudyComparison",
    "SuccessMap",
    "WorstCase",
    "case_study_document",
    "draw_success_map",
]


@dataclass(frozen=True, slots=True)
class Rate:
    """*hits* of *total* cases, with the exact 95 % interval from *low* to *high*. *of* : what is counted."""

    of: str
    hits: int
    total: int
    low: float
    high: float

    @property
    def cells(self) -> tuple[str, ...]:
        """The cells of a table: count, percentage, interval."""
        share = f"{100.0 * self.hits / self.total:.0f} %" if self.total else ""
        return f"{self.hits} of {self.total}", share, f"{100.0 * self.low:.0f} to {100.0 * self.high:.0f} %"


@dataclass(frozen=True, slots=True)
class Spread:
    """Number of values of a result, and their quantiles at 5, 25, 50, 75 and 95 %."""

    of: str
    count: int
    quantiles: tuple[float, ...]


BOUND_CLASSES = tuple(0.5 * k for k in range(-8, 9))
"""Limits of the classes of an error over its bound. The outer classes include all beyond them. Project choice."""


@dataclass(frozen=True, slots=True)
class BoundCheck:
    """Errors against a bound of their standard deviation.

    ``ratio``: rms error over rms bound. ``low``, ``high``: its 95 % range by chance, if the bound is reached.
    ``within``: cases with an error below 1.96 bounds. ``scaled``: cases in each of :data:`BOUND_CLASSES`.
    """

    of: str
    ratio: float
    low: float
    high: float
    within: Rate
    scaled: tuple[int, ...] = ()


@dataclass(frozen=True, slots=True)
class SuccessMap:
    """Success over two varied values: ``hits`` and ``totals`` are rows over *y* of columns over *x*."""

    x: str
    y: str
    xs: tuple[str, ...]
    ys: tuple[str, ...]
    hits: tuple[tuple[int, ...], ...]
    totals: tuple[tuple[int, ...], ...]


@dataclass(frozen=True, slots=True)
class Confusion:
    """How often each answer was given for each true value: ``counts`` are rows over the truth."""

    truths: tuple[str, ...]
    answers: tuple[str, ...]
    counts: tuple[tuple[int, ...], ...]


@dataclass(frozen=True, slots=True)
class WorstCase:
    """A case, its values in words, what happened, and the command that repeats it."""

    case: str
    values: str
    outcome: str
    command: str


@dataclass(frozen=True, slots=True)
class StudyComparison:
    """This study against an earlier one, paired by case.

    ``gained``, ``lost``: cases that succeed only now, or only then, with the p-value of McNemar's exact test.
    ``change``: median change of the measure in the pairs, with the p-value of Wilcoxon's signed-rank test.
    """

    with_: str
    pairs: int
    gained: int
    lost: int
    p_success: float
    measure: str = ""
    change: float = 0.0
    p_measure: float = 1.0


@dataclass(frozen=True, slots=True)
class CaseStudy:
    """The results of a study. Parts that the study has no data for are empty or None."""

    title: str
    code: str
    cases: int
    done: int
    failed: int
    given_up: int
    success: Rate | None = None
    by_value: tuple[tuple[str, Rate], ...] = ()
    map: SuccessMap | None = None
    spreads: tuple[Spread, ...] = ()
    bounds: tuple[BoundCheck, ...] = ()
    confusion: Confusion | None = None
    failures: Mapping[str, int] = field(default_factory=dict)
    worst: tuple[WorstCase, ...] = ()
    against: StudyComparison | None = None
    notes: tuple[str, ...] = ()
    words: Mapping[str, str] = field(default_factory=dict)
    """Names of values and results -> what a reader is shown instead."""

    def in_words(self, text: str) -> str:
        """Return *text* with the names in it replaced by their :attr:`words`."""
        names = "|".join(map(re.escape, sorted(self.words, key=len, reverse=True)))
        return re.sub(rf"(?<![\w.'-])(?:{names})(?![\w.'-])", lambda m: self.words[m[0]], text) if names else text


def case_study_document(study: CaseStudy) -> Document:
    """Return the report of a study."""
    missing = study.cases - study.done - study.failed - study.given_up
    counts = f"{study.done} of {study.cases} cases done, {study.failed} failed, {study.given_up} given up"
    remark = (f"{missing} cases are missing. `study run` continues the study.",) if missing else ()
    sentences = (*remark, *study.notes)
    figures = [KeyFigure(f"{study.done}", "cases done", f"of {study.cases}")]
    text = f"{counts}."
    if study.success is not None:
        number, share, interval = study.success.cells
        aim = study.in_words(study.success.of)
        text = f"{aim[0].upper()}{aim[1:]}: {number} ({share}, 95 % interval {interval}); {counts}."
        figures.insert(0, KeyFigure(share, aim, f"{number}, 95 % interval {interval}"))
    sections = (
        *(
            _map_section(replace(m, x=study.in_words(m.x), y=study.in_words(m.y)))
            if (m := study.map) is not None
            else ()
        ),
        *_rates(study),
        *_results(study),
        *(_confusion(study.confusion) if study.confusion is not None else ()),
        *(_comparison(replace(a, measure=study.in_words(a.measure))) if (a := study.against) is not None else ()),
        *_bad_cases(study),
    )
    return Document(
        study.title,
        sections,
        verdict=Verdict(text, "neutral", sentences),
        about=(study.code,),
        key_figures=tuple(figures),
        facts=asdict(study),
    )


def _map_section(found: SuccessMap) -> Iterator[Section]:
    rows = tuple(
        (y, *(f"{h}/{n}" if n else "" for h, n in zip(hits, totals, strict=True)))
        for y, hits, totals in zip(found.ys, found.hits, found.totals, strict=True)
    )
    note = f"Rows: {found.y}. Columns: {found.x}."
    table = Table(("", *found.xs), "l" + "r" * len(found.xs), rows, note=note)
    figure = Figure("success-map", f"Success over {found.x} and {found.y}.", lambda: _draw_map(found))
    yield Section("map", "Success map", (figure, table), facts=IN_RESULT)


def _draw_map(found: SuccessMap) -> Drawing:
    from matplotlib.figure import Figure as Drawing

    drawing = Drawing(figsize=(5.8, 3.6), layout="constrained")
    drawing.colorbar(draw_success_map(found, drawing.subplots()), label="success")
    return drawing


def draw_success_map(found: SuccessMap, ax: Axes) -> AxesImage:
    """Draw the map into *ax*: colour and count of each cell. Return the image, for a colour bar from 0 to 1."""
    shares = [
        [h / n if n else float("nan") for h, n in zip(*row, strict=True)]
        for row in zip(found.hits, found.totals, strict=True)
    ]
    image = ax.imshow(shares, vmin=0.0, vmax=1.0, cmap="RdYlGn", origin="lower", aspect="auto")
    ax.grid(visible=False)  # it would pass through the counts
    ax.set_xticks(range(len(found.xs)), found.xs)
    ax.set_yticks(range(len(found.ys)), found.ys)
    ax.set_xlabel(found.x)
    ax.set_ylabel(found.y)
    for j, row in enumerate(zip(found.hits, found.totals, strict=True)):
        for i, (h, n) in enumerate(zip(*row, strict=True)):
            colour = "black" if n and 0.15 < h / n < 0.85 else "white"  # the ends of the colours are dark
            ax.annotate(f"{h}/{n}" if n else "", (i, j), ha="center", va="center", fontsize=8, color=colour)
    return image


def _rates(study: CaseStudy) -> Iterator[Section]:
    rows = tuple((study.in_words(value), *rate.cells) for value, rate in study.by_value)
    heads = ("value", "success", "", "95 % interval")
    yield Section("rates", "Success by value", (Table(heads, "lrrr", rows),), facts=IN_RESULT)


def _results(study: CaseStudy) -> Iterator[Section]:
    rows = tuple((study.in_words(s.of), str(s.count), *(f"{q:.4g}" for q in s.quantiles)) for s in study.spreads)
    spreads = Table(("result", "cases", "5 %", "25 %", "median", "75 %", "95 %"), "lrrrrrr", rows)
    named = [replace(b, of=study.in_words(b.of)) for b in study.bounds]
    checks = tuple((b.of, f"{b.ratio:.2f}", f"{b.low:.2f} to {b.high:.2f}", b.within.cells[1]) for b in named)
    note = "By chance, the rms error of an efficient method is in the range of the third column in 95 % of studies."
    bounds = Table(("error", "rms / bound", "by chance", "within 1.96 bounds"), "lrrr", checks, note=note)
    plots = tuple(
        Figure(
            f"bound-{number}",
            f"{check.of[0].upper()}{check.of[1:]} over its bound. The line is the normal distribution of a method that "
            "reaches the bound.",
            partial(_draw_bound, check),
        )
        for number, check in enumerate(named, 1)
        if sum(check.scaled)
    )
    yield Section("results", "Results", (spreads, bounds, *plots), facts=IN_RESULT)


def _draw_bound(found: BoundCheck) -> Drawing:
    from matplotlib.figure import Figure as Drawing

    drawing = Drawing(figsize=(6.4, 3.2), layout="constrained")
    ax = drawing.subplots()
    width, cases = BOUND_CLASSES[1] - BOUND_CLASSES[0], sum(found.scaled)
    ax.bar(BOUND_CLASSES[:-1], found.scaled, width, align="edge", edgecolor="white")
    fine = [0.05 * k for k in range(-80, 81)]
    ax.plot(fine, [cases * width * math.exp(-0.5 * x * x) / math.sqrt(2.0 * math.pi) for x in fine], color="black")
    ax.set_xlabel(f"{found.of} / bound")
    ax.set_ylabel("cases")
    return drawing


def _confusion(found: Confusion) -> Iterator[Section]:
    rows = tuple(
        (truth, *(str(n) if n else "" for n in counts))
        for truth, counts in zip(found.truths, found.counts, strict=True)
    )
    table = Table(("true \\ reported", *found.answers), "l" + "r" * len(found.answers), rows)
    yield Section("confusion", "Reported against true", (table,), facts=IN_RESULT)


def _comparison(found: StudyComparison) -> Iterator[Section]:
    texts = [
        f"{found.pairs} cases are in both studies. {found.gained} succeed only now and {found.lost} only in "
        f"{found.with_} (McNemar, p = {found.p_success:.2g})."
    ]
    if found.measure:
        texts.append(
            f"Median change of {found.measure} in a pair: {found.change:+.4g} (Wilcoxon, p = {found.p_measure:.2g})."
        )
    yield Section("against", f"Compared with {found.with_}", tuple(Note(t) for t in texts), facts=IN_RESULT)


def _outcome(study: CaseStudy, found: WorstCase) -> str:
    name, equals, value = found.outcome.partition(" = ")
    return f"{study.words.get(name, name)}{equals}{value}"


def _bad_cases(study: CaseStudy) -> Iterator[Section]:
    why = Table(("cases", "reason"), "rl", tuple((str(n), reason) for reason, n in study.failures.items()), shown=10)
    yield Section("failures", "Failed cases", (why,), facts=IN_RESULT)
    parts: Sequence[Note] = [
        Note(w.command, f"{study.in_words(w.values)}: {_outcome(study, w)}", kind="command") for w in study.worst
    ]
    title = "Worst cases" if len(study.worst) < study.cases else "All cases, the worst first"
    yield Section("worst", title, tuple(parts), facts=IN_RESULT)
