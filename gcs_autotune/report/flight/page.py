"""The page of a manoeuvre flown, and that of one only previewed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from gcs_autotune.identify import AxisFit
from gcs_autotune.report.study.study import structure_title
from gcs_autotune.report.study.tables import parameter_table
from gcs_autotune.report.summaries import sheet_table
from gcs_autotune.report.toolkit.canvas import AFTER, new_axes, pens, to_svg
from gcs_autotune.report.toolkit.figures import draw_fit, draw_inputs, draw_track, finite, thin
from gcs_autotune.report.toolkit.page import Picture, render_page
from gcs_autotune.report.toolkit.wording import Headline, doubt_sentence, format_moment, format_percent, to_people
from gcs_autotune.seatrials import Sheet
from gcs_autotune.trial import Trial

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["render_flight", "render_preview"]


def render_flight(
    title: str,
    when: str,
    flown: Trial,
    predicted: Trial,
    sheets: Sequence[Sheet],
    fit: AxisFit | None,
    remarks: Sequence[str],
) -> str:
    """Return the page of a manoeuvre: figures, model, signals and the track beside the predicted one."""
    doubts = [*remarks, *(doubt_sentence(d) for s in sheets for d in s.doubts)]
    doubts += [] if fit is None else [doubt_sentence(d) for d in fit.doubts]
    pictures = [*_signals(flown), *_fits(fit, flown), *_tracks({"flown": flown, "predicted": predicted})]
    return _page(title, when, Headline(f"Flown: {flown.reason}.", "good", ()), sheets, fit, doubts, pictures)


def render_preview(title: str, when: str, predicted: Trial, told: str, trouble: str) -> str:
    """Return the page of a manoeuvre that was only previewed; *trouble* is why it had better not be flown."""
    headline = Headline(trouble or f"It takes {told}.", "bad" if trouble else "good", ())
    pictures = [*_signals(predicted), *_tracks({"predicted": predicted})]
    return _page(title, when, headline, (), None, [], pictures)


def _page(
    title: str,
    when: str,
    headline: Headline,
    sheets: Sequence[Sheet],
    fit: AxisFit | None,
    doubts: Sequence[str],
    pictures: Sequence[Picture],
) -> str:
    tiles = [] if fit is None else [(format_percent(fit.fit_percent), "fit", "free run")]
    return render_page(
        "flight/page.html",
        {
            "title": title,
            "when": format_moment(when),
            "headline": headline,
            "tiles": tiles,
            "doubts": tuple(dict.fromkeys(doubts)),
            "sheets": [(s.title, sheet_table(s), s.verdict) for s in sheets],
            "model_title": "" if fit is None else structure_title(fit),
            "parameters": None if fit is None else parameter_table(fit),
            "pictures": pictures,
        },
    )


def _picture(kind: str, caption: str, figure: Figure | None) -> list[Picture]:
    if figure is None:
        return []
    with pens(kind):
        return [Picture(kind, caption, to_svg(figure, kind, caption))]


def _signals(trial: Trial) -> list[Picture]:
    names = [n for n in ("psi", "z", "u") if n in trial and len(trial[n]) > 1][:2]
    inputs = [n for n in ("N", "X", "Z", "Y") if n in trial and len(trial[n]) > 1 and trial[n].values.any()]
    if not names or not inputs:
        return []
    with pens("signals"):
        figure, axes = new_axes((1.7,) * len(names) + (0.9,))
        for ax, name in zip(axes, names, strict=False):
            unit, factor = to_people(trial[name].unit)
            few = thin(finite(trial[name].t - trial.start, factor * trial[name].values))
            ax.plot(few.t, few.y, color=AFTER, lw=1.2)
            ax.set_ylabel(f"{name} [{unit}]")
        draw_inputs(axes[-1], trial, inputs, trial.start, trial.end)
        axes[-1].set_xlabel("time [s]")
    return _picture("signals", "What it did, and what drove it.", figure)


def _fits(fit: AxisFit | None, trial: Trial) -> list[Picture]:
    found: list[Picture] = []
    for i, trace in enumerate(() if fit is None else fit.traces):
        with pens(f"fit-{i}"):
            figure = draw_fit(trace, trial, fit.model if fit is not None else None)
        found += _picture(f"fit-{i}", "The model, free running, against measurement; below, what is left over.", figure)
    return found


def _tracks(runs: Mapping[str, Trial]) -> list[Picture]:
    with pens("track"):
        figure = draw_track({name: _from_origin(trial) for name, trial in runs.items()})
    return _picture("track", "Track from where it began, north up; the prediction starts north.", figure)


def _from_origin(trial: Trial) -> Trial:
    moved = {
        n: replace(c, values=c.values - c.values[0]) if n in ("x", "y") and len(c) else c
        for n, c in trial.channels.items()
    }
    return replace(trial, channels=moved)
