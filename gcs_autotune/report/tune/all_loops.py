"""The report of ``tune all``: one verdict, one table of all loops, and how to undo or continue."""

from __future__ import annotations

import math
import shlex
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import PurePath
from typing import Any

import numpy as np

from gcs_autotune.report.toolkit.document import (
    IN_RESULT,
    Document,
    Note,
    Part,
    Section,
    Table,
    Tone,
    Verdict,
    bullets,
    resume_section,
)
from gcs_autotune.report.toolkit.wording import format_moment, format_number, format_seconds, format_share, sentence
from gcs_autotune.report.tune.wording import SIMULATED_UNDO, not_reached
from gcs_autotune.rounding import counted, format_digits

__all__ = ["JobStep", "JobStory", "job_document", "simulated_with"]

FLOWN = ("kept", "restored", "unchanged", "dry-run", "declined")
"""Endings of a step that is done. A step with any other ending is flown when the job is resumed."""
RECHECK = "recheck "
DIGITS = 3
"""Significant digits of a measured number, the same in the whole column. Project choice."""
WORSE = ("degraded", "poorly damped", "oscillates")
"""Verdicts of a recheck that call for another tune."""
UNDECIDED = ("undecided", "not identifiable")
"""Endings of a recheck that was flown, without a verdict."""
NO_RECHECK = {"open": "not flown yet", "aborted": "ended early", "rejected": "not possible", "skipped": "left out"}
"""Endings of a recheck that is missing, in words."""


@dataclass(frozen=True, slots=True)
class JobStep:
    """One step of a job, from its own summary.

    Attributes
    ----------
    name : what was tuned, or ``recheck`` and an axis.
    directory : its run directory, relative to that of the job; empty: not flown.
    ending : that of the tune, or ``rejected`` by its checks, ``skipped``, or ``open`` if it was not reached; the
        verdict of a recheck.
    gains : parameter -> (old, new).
    before, after : metrics of the proof, by the names of ``summary.json``; empty if not measured.
    seconds, took : announced and actual duration [s] of the vehicle's time, with the return before it.
    """

    name: str
    directory: str = ""
    ending: str = "open"
    reason: str = ""
    gains: Mapping[str, tuple[float, float]] | None = None
    before: Mapping[str, Any] | None = None
    after: Mapping[str, Any] | None = None
    seconds: float = 0.0
    took: float = 0.0

    @property
    def is_recheck(self) -> bool:
        """Whether it only flies the loop of an earlier step again."""
        return self.name.startswith(RECHECK)

    @property
    def is_done(self) -> bool:
        """Whether it needs not be flown when the job is resumed."""
        return self.ending in FLOWN or (self.is_recheck and self.ending not in ("open", "aborted", "rejected"))

    def to_dict(self) -> dict[str, Any]:
        """Return plain data."""
        return {name: getattr(self, name) for name in self.__slots__}


def simulated_with(link: str, gains: Mapping[str, float]) -> str:
    """Return the *link* of a simulated vehicle that starts with *gains*."""
    pieces = "&".join(f"param={name}={np.float32(value)!s}" for name, value in gains.items())
    return f"{link}{'&' if '?' in link else '?'}{pieces}" if pieces else link


@dataclass(frozen=True, slots=True)
class JobStory:
    """A ``tune all`` as far as it came.

    ``announced``: the announcement. ``stopped``: why it ended early; empty if it did not. ``link``: connection of the
    vehicle. ``options``: further options of the command.
    """

    when: str
    vehicle: str
    simulated: bool
    link: str
    directory: str
    steps: tuple[JobStep, ...] = ()
    announced: tuple[str, ...] = ()
    stopped: str = ""
    options: str = ""

    @property
    def seconds(self) -> tuple[float, float]:
        """Announced and actual duration [s] of the steps that were flown."""
        flown = [step for step in self.steps if step.took > 0.0]
        return sum(step.seconds for step in flown), sum(step.took for step in flown)

    @property
    def undo(self) -> str:
        """The command that restores the parameters of before the job. A simulated vehicle has no link any more."""
        link = "" if self.simulated else f" --connect {shlex.quote(self.link)}"
        return f"gcs-autotune params restore {_path(self)}{link}"

    @property
    def resume(self) -> str:
        """The command that continues at the next step that is not done; empty if all are."""
        if all(step.is_done for step in self.steps) and not self.stopped:
            return ""
        return f"gcs-autotune tune all{self.options} --connect {shlex.quote(self._link_now)} --resume {_path(self)}"

    @property
    def _link_now(self) -> str:
        """The link of a resumed job. A simulated vehicle ends with its run and starts with the gains kept so far."""
        if not self.link.startswith("sitl:"):
            return self.link
        kept = [(n, new) for step in self.steps if step.ending == "kept" for n, (_, new) in (step.gains or {}).items()]
        return simulated_with(self.link, dict(kept))

    @property
    def ending(self) -> str:
        """``kept`` if a step kept its gains, ``aborted`` if the job ended early, ``unchanged`` otherwise."""
        if self.stopped:
            return "aborted"
        return "kept" if any(step.ending == "kept" for step in self.steps) else "unchanged"

    def to_dict(self) -> dict[str, Any]:
        """Return plain data."""
        return {
            "schema": 1,
            "title": "tune all",
            "when": self.when,
            "vehicle": self.vehicle,
            "ending": self.ending,
            "reason": self.stopped,
            "seconds": {"announced": self.seconds[0], "took": self.seconds[1]},
            "steps": [step.to_dict() for step in self.steps],
        }


def _path(story: JobStory) -> str:
    return shlex.quote(str(PurePath(story.directory)))


def job_document(story: JobStory) -> Document:
    """Return the report of a ``tune all``."""
    return Document(
        title=f"Tune all: {story.ending}",
        about=(story.vehicle or "vehicle not identified",),
        when=format_moment(story.when),
        badge="simulated vehicle" if story.simulated else "",
        verdict=_verdict(story),
        sections=tuple(_sections(story)),
        facts=story.to_dict(),
    )


def _verdict(story: JobStory) -> Verdict:
    tuned = [step for step in story.steps if not step.is_recheck]
    counts = Counter(step.ending for step in tuned)
    told = ", ".join(f"{counts[e]} {e}" for e in (*FLOWN, "aborted", "rejected", "skipped", "open") if counts[e])
    worse = [s for s in story.steps if s.is_recheck and s.ending in WORSE]
    text = f"{counted(len(tuned), 'loop')}: {told}." if tuned else "Nothing was tuned."
    bad = bool(story.stopped or worse or counts["aborted"] or counts["rejected"] or counts["skipped"])
    tone: Tone = "bad" if bad else "good" if counts["kept"] else "neutral"
    sentences = [sentence(story.stopped)] if story.stopped else []
    for step in tuned:
        if step.ending == "kept":
            gains = ", ".join(f"{name} {change}" for name, change in _changes(step))
            sentences.append(f"{sentence(f'{step.name}: {_better(step)}')} {gains}{'.' * bool(gains)}".rstrip())
    sentences += [sentence(f"{step.name}: {_why(step)}") for step in story.steps if _is_failed_recheck(step)]
    return Verdict(text, tone, tuple(sentences))


def _why(step: JobStep) -> str:
    """Return what a recheck found, or why it is missing."""
    missing = NO_RECHECK.get(step.ending, "")
    join = ", " if step.reason.startswith("because ") else ": "
    return join.join(filter(None, (missing, step.reason))) or step.ending


def _better(step: JobStep) -> str:
    """Return by how much a step that kept its gains changed the measured error."""
    for name, what in (("itae", "tracking error"), ("rms", "distance from the route (rms)")):
        old, new = (_figure(metrics or {}, name) for metrics in (step.before, step.after))
        if math.isfinite(new) and old > 0.0:
            change = 100.0 * (new / old - 1.0)
            size = f"{abs(change):.0f} %" if abs(change) >= 1.0 else "less than 1 %"
            return f"the new gains are kept, {what} {size} {'lower' if change <= 0.0 else 'higher'} (measured)"
    return "the new gains are kept"


def _figure(metrics: Mapping[str, Any], name: str) -> float:
    """Return a metric, of several legs the largest; NaN if it is missing or no number."""
    value = metrics.get(name)
    if isinstance(value, (list, tuple)):
        value = max(value, default=math.nan)
    return float(value) if isinstance(value, (int, float)) else math.nan


def _sections(story: JobStory) -> Iterator[Section]:
    rows = tuple(row for step in story.steps for row in _rows(step))
    heads = ("loop", "gain", "old -> new", "error", "overshoot", "settling", "result")
    errors = Note(
        "Error: ITAE of the unit step [s²]; of a line, the rms distance from the route, and as overshoot the farthest "
        "corner. Before and after; predicted only where no proof was flown.",
        kind="quiet",
    )
    table = Table(heads, "lllllll", rows, wide=heads[4:6])
    yield Section("loops", "Loops", (table, errors, *_reports(story)), facts=IN_RESULT)
    other = [s for s in story.steps if s.ending != "kept" and not _is_failed_recheck(s)]
    reasons = tuple(f"{s.name}: {s.reason}" for s in other if s.reason)
    if reasons:
        yield Section("reasons", "Remarks", tuple(bullets(reasons)), facts=IN_RESULT)
    if story.resume:
        yield resume_section(story.resume, "The next step:")
    if any(step.ending == "kept" for step in story.steps):
        told = f"{SIMULATED_UNDO}:" if story.simulated else "This restores the parameters of before all steps:"
        undo = Note(story.undo, told, kind="command")
        yield Section("undo", "How to undo", (undo,), facts=IN_RESULT)
    yield Section("details", "Time and steps", tuple(_details(story)), detail=True, facts=IN_RESULT)


def _reports(story: JobStory) -> Iterator[Note]:
    """Yield a link to the report of each step that was flown."""
    for step in story.steps:
        if step.directory:
            yield Note(f"Report of {step.name}", kind="bullet", detail=True, file=f"{step.directory}/report.html")


def _is_failed_recheck(step: JobStep) -> bool:
    """Return whether *step* is a recheck that failed or is missing; the verdict states why."""
    return step.is_recheck and step.ending in (*WORSE, *UNDECIDED, *NO_RECHECK)


def _details(story: JobStory) -> Iterator[Part]:
    announced, took = story.seconds
    if took:
        times = f"announced {format_seconds(announced)}, took {format_seconds(took)} of the vehicle's time"
        yield Note(f"Completed steps: {times}.")
    yield Section("announced", "Announced before the start", tuple(bullets(story.announced)))


def _rows(step: JobStep) -> Iterator[tuple[str, ...]]:
    measured = [_pair(step, *names) for names in (("itae", "rms"), ("overshoot", "corners"), ("settling", ""))]
    gains = [] if step.ending == "aborted" else _changes(step)  # those of an aborted step were not proved
    for k, (name, change) in enumerate(gains or [("", "")]):
        first = k == 0
        cells = measured if first else ["", "", ""]
        yield (step.name if first else "", name, change, *cells, step.ending if first else "")


def _changes(step: JobStep) -> list[tuple[str, str]]:
    """Return each gain of a step and its old and new value as text."""
    return [(name, " -> ".join(map(format_number, pair))) for name, pair in (step.gains or {}).items()]


def _pair(step: JobStep, name: str, of_line: str) -> str:
    shown = [_cell(metrics, name, of_line) for metrics in (step.before, step.after) if metrics]
    shown = [text for text in shown if text]
    unit = "s²" if name == "itae" else "s" if name == "settling" else ""
    if not any(name in metrics for metrics in (step.before, step.after) if metrics):
        unit = "m"
    numbers = [k for k, text in enumerate(shown) if text[-1].isdigit()]
    if unit and numbers:
        shown[numbers[-1]] += f" {unit}"
    return " -> ".join(shown)


def _cell(metrics: Mapping[str, Any], name: str, of_line: str) -> str:
    value = _figure(metrics, name if name in metrics else of_line)
    if not math.isfinite(value):
        unknown = _unsettled(metrics) if name == "settling" else "unknown"
        return unknown if name in metrics or of_line in metrics else ""
    return format_share(value) if name == "overshoot" and name in metrics else format_digits(value, DIGITS)


def _unsettled(metrics: Mapping[str, Any]) -> str:
    """Return why there is no settling time, as in the report of the tune itself."""
    if metrics.get("hidden_by_noise"):
        return "hidden by noise"
    return not_reached(_figure(metrics, "span"), "not settled")
