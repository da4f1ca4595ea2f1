"""The page of a flight (a manoeuvre or a plan), and of a preview."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from gcs_autotune.identify import Fit, Validation
from gcs_autotune.report.plots import label_as_read
from gcs_autotune.report.study.study import structure_title
from gcs_autotune.report.study.tables import parameter_table, unseen_table
from gcs_autotune.report.summaries import sheet_table
from gcs_autotune.report.toolkit.canvas import AFTER, new_axes, pens, to_svg
from gcs_autotune.report.toolkit.figures import draw_fit, draw_inputs, draw_track, finite, thin
from gcs_autotune.report.toolkit.page import Picture, Table, render_page
from gcs_autotune.report.toolkit.wording import (
    Headline,
    Tone,
    doubt_sentence,
    format_moment,
    format_percent,
    format_seconds,
    to_people,
)
from gcs_autotune.seatrials import Sheet
from gcs_autotune.trial import Trial

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["FlightModel", "TrialTold", "render_flight", "render_preview"]


@dataclass(frozen=True, slots=True, eq=False)
class FlightModel:
    """A model identified from a flight; ``unseen``: its prediction of the runs ``held_out``, if any."""

    fit: Fit
    held_out: Sequence[str] = ()
    unseen: Validation | None = None

    def to_dict(self) -> dict[str, object]:
        """Return plain data."""
        told = None if self.unseen is None else self.unseen.fit_percent
        return {"dof": self.fit.dof, "fit": self.fit.to_dict(), "held_out": list(self.held_out), "prediction": told}


@dataclass(frozen=True, slots=True)
class TrialTold:
    """A run of a self-planned trial: ``why`` it was flown, its duration [s], the precision ``known`` after it, how
    well [%] the previous model predicted it (``foretold``; NaN: there was none), and why it was the last.
    """

    run: str
    why: str
    seconds: float
    known: str
    foretold: float
    ended: str


def render_flight(
    title: str,
    when: str,
    flown: Sequence[tuple[str, Trial]],
    predicted: Trial | None,
    sheets: Sequence[Sheet],
    models: Sequence[FlightModel],
    remarks: Sequence[str],
    story: Sequence[TrialTold] = (),
) -> str:
    """Return the page of a flight: figures, models, and of each run (name, record) signals and track.

    predicted : the predicted run, for the track of a single run. story : of a self-planned trial.
    """
    doubts = [*remarks, *(doubt_sentence(d) for s in sheets for d in s.doubts)]
    doubts += [doubt_sentence(d) for m in models for d in m.fit.doubts]
    pictures = [p for name, run in flown[:MOST_SIGNALS] for p in _signals(run, name if len(flown) > 1 else "")]
    pictures += [p for m in models for p in _fits(m, {t.name: t for _, t in flown})]
    alone = len(flown) == 1
    named = {"flown" if alone else name: run for name, run in flown}
    pictures += _tracks(named if predicted is None else {**named, "predicted": predicted})
    what = flown[0][1].reason if alone else f"{len(flown)} runs, {_together([t for _, t in flown])}"
    oscillates = any(figure.slug == "oscillation" for sheet in sheets for figure in sheet.figures)
    tone: Tone = "bad" if oscillates else "good"
    verdict = Headline(f"Flown: {what}.", tone, (f"{story[-1].known}: {story[-1].ended}.",) if story else ())
    return _page(title, when, verdict, sheets, models, doubts, pictures, () if alone else flown, story)


def _together(runs: Sequence[Trial]) -> str:
    return format_seconds(sum(run.duration for run in runs))


def render_preview(title: str, when: str, seen: Sequence[tuple[str, Trial, str, str]]) -> str:
    """Return the page of a preview: per run its name, record, time and space, and the reason not to fly it, if any."""
    troubles = [trouble if len(seen) == 1 else f"{name}: {trouble}" for name, _, _, trouble in seen if trouble]
    good = f"It takes {seen[0][2]}." if len(seen) == 1 else f"{len(seen)} runs, {_together([s[1] for s in seen])}."
    told = tuple(f"{name}: {words}." for name, _, words, _ in seen) if len(seen) > 1 else ()
    headline = Headline(troubles[0] if troubles else good, "bad" if troubles else "good", (*troubles[1:], *told))
    pictures = _signals(seen[0][1], predicted=True) if len(seen) == 1 else []
    pictures += _tracks({"predicted" if len(seen) == 1 else name: trial for name, trial, _, _ in seen})
    return _page(title, when, headline, (), (), [], pictures, pictured="Prediction")


def _page(
    title: str,
    when: str,
    headline: Headline,
    sheets: Sequence[Sheet],
    models: Sequence[FlightModel],
    doubts: Sequence[str],
    pictures: Sequence[Picture],
    runs: Sequence[tuple[str, Trial]] = (),
    story: Sequence[TrialTold] = (),
    *,
    pictured: str = "Record",
) -> str:
    tiles = [(format_percent(m.fit.fit_percent), f"fit, {m.fit.dof}", "free run") for m in models]
    tiles += [(format_percent(m.unseen.fit_percent), "prediction", ", ".join(m.held_out)) for m in models if m.unseen]
    return render_page(
        "flight/page.html",
        {
            "title": title,
            "when": format_moment(when),
            "headline": headline,
            "tiles": tiles,
            "doubts": tuple(dict.fromkeys(doubts)),
            "runs": _runs(runs) if runs else None,
            "story": _story(story) if story else None,
            "sheets": [(f"{s.run}: {s.title}" if runs else s.title, sheet_table(s), s.verdict) for s in sheets],
            "models": [
                (structure_title(fit), parameter_table(fit), unseen_table(m.unseen, fit.dof) if m.unseen else None)
                for m in models
                for fit in [m.fit]
            ],
            "pictures": pictures,
            "pictured": pictured,
        },
    )


def _runs(runs: Sequence[tuple[str, Trial]]) -> Table:
    rows = tuple((name, format_seconds(trial.duration), trial.reason) for name, trial in runs)
    return Table(("run", "length", "end"), "lrl", rows)


def _story(steps: Sequence[TrialTold]) -> Table:
    rows = tuple(
        (
            s.run,
            s.why,
            format_seconds(s.seconds),
            "" if math.isnan(s.foretold) else format_percent(s.foretold) if math.isfinite(s.foretold) else "diverges",
            s.known,
        )
        for s in steps
    )
    return Table(("run", "why", "length", "held-out prediction", "precision after it"), "llrrl", rows)


MOST_SIGNALS = 12
"""Most runs whose signals are plotted; chosen so that the page stays small."""


def _picture(kind: str, caption: str, figure: Figure | None) -> list[Picture]:
    if figure is None:
        return []
    with pens(kind):
        return [Picture(kind, caption, to_svg(figure, kind, caption))]


def _signals(trial: Trial, name: str = "", *, predicted: bool = False) -> list[Picture]:
    names = [n for n in ("psi", "z", "u") if n in trial and len(trial[n]) > 1 and np.ptp(trial[n].values) > 0.0][:2]
    inputs = [n for n in ("N", "X", "Z", "Y") if n in trial and len(trial[n]) > 1 and trial[n].values.any()]
    if not names or not inputs:
        return []
    with pens("signals"):
        figure, axes = new_axes((1.7,) * len(names) + (0.9,))
        for ax, signal in zip(axes, names, strict=False):
            unit, factor = to_people(trial[signal].unit)
            few = thin(finite(trial[signal].t - trial.start, factor * trial[signal].values))
            ax.plot(few.t, few.y, color=AFTER, lw=1.2)
            ax.set_ylabel(f"{signal} [{unit}]")
            label_as_read(ax, signal, float(few.y[0]) if len(few) else 0.0)
        draw_inputs(axes[-1], trial, inputs, trial.start, trial.end)
        axes[-1].set_xlabel("time [s]")
    told = "predicted motion and input." if predicted else "motion and input."
    return _picture(f"signals{name}", f"{name}: {told}" if name else f"{told[0].upper()}{told[1:]}", figure)


def _fits(model: FlightModel, runs: Mapping[str, Trial]) -> list[Picture]:
    found: list[Picture] = []
    unseen = () if model.unseen is None else model.unseen.traces
    told = "Model (free run) and measurement. Below: the residual."
    for i, (trace, caption) in enumerate(
        [*((t, told) for t in model.fit.traces), *((t, f"Held-out prediction of {t.run}.") for t in unseen)]
    ):
        if trace.run not in runs:
            continue
        name = f"fit-{model.fit.dof}-{i}"
        with pens(name):
            figure = draw_fit(trace, runs[trace.run], model.fit.model)
        found += _picture(name, caption, figure)
    return found


def _tracks(runs: Mapping[str, Trial]) -> list[Picture]:
    with pens("track"):
        figure = draw_track({name: _from_origin(trial) for name, trial in runs.items()})
    return _picture("track", "Track from its start, north up; the prediction starts heading north.", figure)


def _from_origin(trial: Trial) -> Trial:
    moved = {
        n: replace(c, values=c.values - c.values[0]) if n in ("x", "y") and len(c) else c
        for n, c in trial.channels.items()
    }
    return replace(trial, channels=moved)
