"""The report of a flight (a manoeuvre or a plan) and of a preview, with one function per section."""

from __future__ import annotations

import math
import shlex
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np

from gcs_autotune.identify import Fit, Model, Validation
from gcs_autotune.models import SingleDof
from gcs_autotune.report.plots import label_as_read
from gcs_autotune.report.study.document import damping_section, model_section, precision_section
from gcs_autotune.report.study.study import answer_sentences
from gcs_autotune.report.study.tables import unseen_table
from gcs_autotune.report.summaries import sheet_section, sheet_table
from gcs_autotune.report.toolkit.axis_fit import explained_sentence
from gcs_autotune.report.toolkit.canvas import AFTER, new_axes
from gcs_autotune.report.toolkit.document import (
    IN_RESULT,
    Document,
    Figure,
    KeyFigure,
    Note,
    Section,
    Table,
    Verdict,
    cautions,
    notes,
)
from gcs_autotune.report.toolkit.figures import draw_fit, draw_inputs, draw_track, finite, thin
from gcs_autotune.report.toolkit.goldfarb import goldfarb_figure
from gcs_autotune.report.toolkit.wording import (
    NOTHING_WRITTEN,
    format_moment,
    format_percent,
    format_seconds,
    remarks,
    sentence,
    to_people,
)
from gcs_autotune.seatrials import Sheet
from gcs_autotune.trial import Trial

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Drawing

    from gcs_autotune.identify.relay import PredictedCycle

__all__ = ["FlightModel", "FlightStory", "TrialSummary", "flight_document", "preview_document"]


@dataclass(frozen=True, slots=True, eq=False)
class FlightModel:
    """A model identified from a flight; ``unseen``: its prediction of the runs ``held_out``, if any."""

    fit: Fit[Model]
    held_out: Sequence[str] = ()
    unseen: Validation | None = None

    def to_dict(self) -> dict[str, object]:
        """Return the model and its prediction as plain data for JSON."""
        told = None if self.unseen is None else self.unseen.fit_percent
        return {"dof": self.fit.dof, "fit": self.fit.to_dict(), "held_out": list(self.held_out), "prediction": told}


@dataclass(frozen=True, slots=True)
class TrialSummary:
    """A run of a self-planned trial.

    ``why``: the reason for the run.
    ``seconds``: its duration [s].
    ``known``: the precision after it, as text.
    ``predicted``: how well [%] the previous model predicted it; NaN: there was no such model.
    ``ended``: reason why the trial ended after this run; empty for earlier runs.
    """

    run: str
    why: str
    seconds: float
    known: str
    predicted: float
    ended: str


@dataclass(frozen=True, slots=True, eq=False)
class FlightStory:
    """A flight: one or several runs, and the results from them.

    ``when``: date and time, ISO 8601.
    ``flown``: the runs as (name, record).
    ``predicted``: the predicted run, for the track of a single run.
    ``sheets``, ``models``: results from the records.
    ``remarks``: results that the records do not determine.
    ``steps``: runs of a self-planned trial.
    ``directory``: the run directory as the user typed it; empty if nothing is to follow.
    ``has_authority``: whether the models determine any figure of `authority`.
    """

    title: str
    when: str
    flown: Sequence[tuple[str, Trial]]
    predicted: Trial | None = None
    sheets: Sequence[Sheet] = ()
    models: Sequence[FlightModel] = ()
    remarks: Sequence[str] = ()
    steps: Sequence[TrialSummary] = ()
    directory: str = ""
    has_authority: bool = True

    @property
    def is_single(self) -> bool:
        """Whether the flight is one run."""
        return len(self.flown) == 1


def flight_document(story: FlightStory) -> Document:
    """Return the report of a flight: its manoeuvring figures and models, and the signals and track of each run."""
    flown, steps = story.flown, story.steps
    what = flown[0][1].reason if story.is_single else f"{len(flown)} runs, {_together([t for _, t in flown])}"
    oscillates = any(figure.slug == "oscillation" for sheet in story.sheets for figure in sheet.figures)
    ended = (f"{steps[-1].known}: {steps[-1].ended}.",) if steps else ()
    doubts = (
        *cautions(story.remarks),
        *(text for sheet in story.sheets for text in remarks(sheet.doubts)),
        *(text for model in story.models for text in remarks(model.fit.doubts)),
    )
    return Document(
        title=story.title,
        when=format_moment(story.when),
        verdict=Verdict(_flown(what), "bad" if oscillates else "good", (*ended, *_found(story, bool(doubts)))),
        key_figures=tuple(_key_figures(story)),
        doubts=tuple(dict.fromkeys(doubts)) or None,
        sections=tuple(section for make in SECTIONS for section in make(story)),
        facts={
            "schema": 1,
            "sheets": [sheet.to_dict() for sheet in story.sheets],
            "models": [model.to_dict() for model in story.models],
        },
    )


def _flown(what: str) -> str:
    """Return the end of a flight as a sentence that contains "flown" once."""
    return sentence(what if "flown" in what.split() else f"Flown: {what}")


SET = ("helm", "heading change at helm reversal", "total heading change")
"""Figures that were commanded, not found."""
MOST_FIGURES = 3
"""Largest number of figures in the verdict. Project choice."""


def _found(story: FlightStory, doubtful: bool) -> Iterator[str]:
    """Yield sentences on what the flight gave: the first figures, the models, and what can be undone."""
    for sheet in story.sheets:
        rows = [row for row in sheet_table(sheet).rows if row[0] not in SET][:MOST_FIGURES]
        shown = "; ".join(f"{name}: {value.partition(' ±')[0]}{_apart(unit)}" for name, value, unit, *_ in rows)
        verdict = f" {sentence(sheet.verdict)}" if sheet.verdict else ""
        yield f"{sheet.title[:1].upper()}{sheet.title[1:]}. {sentence(shown)}{verdict}"
    for model in story.models:
        yield f"Model of {model.fit.dof}: {format_percent(model.fit.fit_percent)} of the motion explained."
    if doubtful:
        yield "See the doubts before you use these results."
    yield NOTHING_WRITTEN


def _apart(unit: str) -> str:
    return unit if not unit or unit.startswith("\N{DEGREE SIGN}") else f" {unit}"


def _next(story: FlightStory) -> Iterator[Section]:
    """Yield the commands that use the result."""
    if story.directory and story.models:
        folder = shlex.quote(story.directory)
        able = Note(f"gcs-autotune authority {folder}", "What the craft can do, from these models:", kind="command")
        commands = (
            *((able,) if story.has_authority else ()),
            Note(
                f"gcs-autotune diagnose {folder}",
                "Physical causes that a plain simulation of this craft lacks:",
                kind="command",
            ),
        )
        yield Section("next", "What next", commands, facts=IN_RESULT)


def preview_document(
    title: str,
    when: str,
    seen: Sequence[tuple[str, Trial, str, str]],
    cycles: Mapping[str, tuple[SingleDof, PredictedCycle]] = MappingProxyType({}),
) -> Document:
    """Return the report of a preview: for each run its name, signals, time and space, and the reason not to fly it, if
    any.

    cycles : run -> model and predicted limit cycle of its relay.
    """
    troubles = [trouble if len(seen) == 1 else f"{name}: {trouble}" for name, _, _, trouble in seen if trouble]
    alone = f"The manoeuvre alone: {seen[0][2]}."
    good = alone if len(seen) == 1 else f"{len(seen)} runs, {_together([s[1] for s in seen])}."
    each = tuple(f"{name} alone: {words}." for name, _, words, _ in seen) if len(seen) > 1 else ()
    rest = (*troubles[1:], *(each if len(seen) > 1 or not troubles else (good,)))
    figures = _signals(seen[0][1], predicted=True) if len(seen) == 1 else ()
    track = _track({"predicted" if len(seen) == 1 else name: trial for name, trial, _, _ in seen})
    return Document(
        title=title,
        when=format_moment(when),
        verdict=Verdict(troubles[0] if troubles else good, "bad" if troubles else "good", rest),
        sections=(
            Section("record", "Prediction", (*figures, track), facts=IN_RESULT),
            *(
                Section(
                    f"cycle-{name}",
                    f"Limit cycle of {name}",
                    (goldfarb_figure(*pair, f"goldfarb-{name}"),),
                    facts=IN_RESULT,
                )
                for name, pair in cycles.items()
            ),
        ),
    )


def _together(runs: Sequence[Trial]) -> str:
    return format_seconds(sum(run.duration for run in runs))


def _key_figures(story: FlightStory) -> Iterator[KeyFigure]:
    for model in story.models:
        yield KeyFigure(format_percent(model.fit.fit_percent), f"fit, {model.fit.dof}", "free run")
    for model in story.models:
        if model.unseen is not None:
            yield KeyFigure(format_percent(model.unseen.fit_percent), "prediction", ", ".join(model.held_out))


def _runs(story: FlightStory) -> Iterator[Section]:
    if not story.is_single:
        rows = tuple((name, format_seconds(trial.duration), trial.reason) for name, trial in story.flown)
        table = Table(("run", "length", "end"), "lrl", rows)
        yield Section("runs", "Runs", (table,), facts=IN_RESULT)


_HOW_TO_READ_COURSE = (
    "After each run the model was identified again. The next run was the one expected to reach the required precision "
    'in the least time. "Held-out prediction": how much of a run the model from the earlier runs explained.'
)


def _course(story: FlightStory) -> Iterator[Section]:
    if story.steps:
        rows = tuple((s.run, s.why, format_seconds(s.seconds), _predicted(s), s.known) for s in story.steps)
        table = Table(("run", "reason", "length", "held-out prediction", "precision after the run"), "llrrl", rows)
        note = Note(_HOW_TO_READ_COURSE, kind="quiet")
        yield Section("story", "Course of the trial", (note, table), facts=IN_RESULT)


def _predicted(step: TrialSummary) -> str:
    if math.isnan(step.predicted):
        return ""
    return format_percent(step.predicted) if math.isfinite(step.predicted) else "diverges"


def _sheets(story: FlightStory) -> Iterator[Section]:
    for i, sheet in enumerate(story.sheets, start=1):
        yield sheet_section(sheet, f"figures-{i}", facts=IN_RESULT)


def _models(story: FlightStory) -> Iterator[Section]:
    for i, model in enumerate(story.models, start=1):
        section = model_section(model.fit, f"model-{i}")
        unseen = unseen_table(model.unseen, model.fit.dof)
        held_out = Section(f"held-out-{i}", f"Held-out prediction of {', '.join(model.held_out)}", (unseen,))
        said = (explained_sentence(model.fit.fit_percent), *answer_sentences(model.fit))
        yield replace(section, parts=(*notes(said), *section.parts, held_out))
        yield from (replace(part, slug=f"damping-{i}", folded=True) for part in damping_section(model.fit))
        yield precision_section(model.fit, section.slug)


def _record(story: FlightStory) -> Iterator[Section]:
    runs = dict(story.flown)
    named = {"flown": story.flown[0][1]} if story.is_single else runs
    parts = (
        *(f for name, run in story.flown[:MOST_SIGNALS] for f in _signals(run, "" if story.is_single else name)),
        *(f for model in story.models for f in _fits(model, {t.name: t for t in runs.values()})),
        _track(named, () if story.predicted is None else [_onto(story.predicted, story.flown[0][1])]),
    )
    has_diagram = any(sheet.shape is not None for sheet in story.sheets)
    yield Section("record", "Record", parts, facts=IN_RESULT, folded=has_diagram)


SECTIONS = (_runs, _course, _sheets, _models, _record, _next)
"""Functions that return the sections of the report, in their order. To add a section, add its function here."""


MOST_SIGNALS = 12
"""Largest number of runs whose signals are plotted, so that the page stays small. Project choice."""


def _signals(trial: Trial, name: str = "", *, predicted: bool = False) -> Iterator[Figure]:
    """Yield the plots of motion and inputs of a run, if it has both."""
    signals = [n for n in ("psi", "z", "u") if n in trial and len(trial[n]) > 1 and np.ptp(trial[n].values) > 0.0][:2]
    inputs = [n for n in ("N", "X", "Z", "Y") if n in trial and len(trial[n]) > 1 and trial[n].values.any()]
    if not signals or not inputs:
        return
    what = "predicted motion and input." if predicted else "motion and input."
    caption = f"{name}: {what}" if name else f"{what[0].upper()}{what[1:]}"
    yield Figure(f"signals{name}", caption, partial(_draw_signals, trial, signals, inputs))


def _draw_signals(trial: Trial, signals: Sequence[str], inputs: Sequence[str]) -> Drawing:
    figure, axes = new_axes((1.7,) * len(signals) + (0.9,))
    for ax, signal in zip(axes, signals, strict=False):
        unit, factor = to_people(trial[signal].unit)
        few = thin(finite(trial[signal].t - trial.start, factor * trial[signal].values))
        ax.plot(few.t, few.y, color=AFTER, lw=1.2)
        ax.set_ylabel(f"{signal} [{unit}]")
        label_as_read(ax, signal, float(few.y[0]) if len(few) else 0.0)
    draw_inputs(axes[-1], trial, inputs, trial.start, trial.end)
    axes[-1].set_xlabel("time [s]")
    return figure


def _fits(model: FlightModel, runs: Mapping[str, Trial]) -> Iterator[Figure]:
    own = "Model (simulated from the inputs alone) and measurement. Below: the residual."
    unseen = () if model.unseen is None else model.unseen.traces
    shown = [*((t, own) for t in model.fit.traces), *((t, f"Held-out prediction of {t.run}.") for t in unseen)]
    for i, (trace, caption) in enumerate(shown):
        if trace.run in runs:
            draw = partial(draw_fit, trace, runs[trace.run], model.fit.model)
            yield Figure(f"fit-{model.fit.dof}-{i}", caption, draw)


def _track(runs: Mapping[str, Trial], predicted: Sequence[Trial] = ()) -> Figure:
    """Return the tracks of *runs* from their starts, and those *predicted* as they are."""
    caption = "Track from its start, north up."
    if predicted:
        caption += " The predicted track is turned and shifted onto the flown one."
    shown = {n: _from_origin(trial) for n, trial in runs.items()}
    shown.update(("predicted", trial) for trial in predicted)
    return Figure("track", caption, partial(draw_track, shown))


def _onto(predicted: Trial, flown: Trial) -> Trial:
    """Return the predicted run turned and shifted onto the flown one, to the same heading and position at the first
    execute, or else at the start.
    """
    if any(name not in run or len(run[name]) < 2 for run in (predicted, flown) for name in ("psi", "x", "y")):
        return predicted
    target, own = _pose(_from_origin(flown)), _pose(predicted)
    turn = target[2] - own[2]
    x, y = predicted["x"], predicted["y"]
    c, s = math.cos(turn), math.sin(turn)
    moved = {}
    for name, to, along, across in (("x", target[0], c, -s), ("y", target[1], s, c)):
        t = predicted[name].t
        north, east = np.interp(t, x.t, x.values) - own[0], np.interp(t, y.t, y.values) - own[1]
        moved[name] = replace(predicted[name], values=to + along * north + across * east)
    return replace(predicted, channels={**predicted.channels, **moved})


def _pose(run: Trial) -> tuple[float, float, float]:
    """Return north, east [m] and heading [rad] at the first execute, or else at the start."""
    t = next((m.t for m in run.marks if m.kind == "execute"), run.start)
    north, east = (float(np.interp(t, run[n].t, run[n].values)) for n in "xy")
    return north, east, float(np.interp(t, run["psi"].t, np.unwrap(run["psi"].values)))


def _from_origin(trial: Trial) -> Trial:
    moved = {
        n: replace(c, values=c.values - c.values[0]) if n in ("x", "y") and len(c) else c
        for n, c in trial.channels.items()
    }
    return replace(trial, channels=moved)
