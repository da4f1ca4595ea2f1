"""The page of a diagnosis: one self-contained HTML file that opens offline."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from gcs_autotune.diagnose import Cause, Diagnosis, MissingForce, Numbers, Portrait
from gcs_autotune.effects import EFFECTS
from gcs_autotune.identify import Trace
from gcs_autotune.report.diagnosis.cause_wording import cannot_tell, cause_remarks, cause_title
from gcs_autotune.report.diagnosis.figures import (
    View,
    draw_curve,
    draw_flight,
    draw_gains,
    draw_left,
    draw_missing,
    draw_view,
    telling_view,
    views_of,
)
from gcs_autotune.report.diagnosis.lead import hint_stories, lead_sentence
from gcs_autotune.report.diagnosis.tables import cause_table, gains_table, numbers_table, ranking_table, steps_of
from gcs_autotune.report.diagnosis.wording import (
    base_error,
    commands,
    effect_words,
    first_gain,
    interval_words,
    left_sentence,
    missing_over,
    numbers_title,
    rests_on,
    signal_words,
    verdict_headline,
)
from gcs_autotune.report.toolkit.canvas import pens, to_svg
from gcs_autotune.report.toolkit.figures import draw_track, inputs_of
from gcs_autotune.report.toolkit.page import Picture, Table, render_page
from gcs_autotune.report.toolkit.wording import doubt_sentence, format_error, format_moment, format_share
from gcs_autotune.trial import Trial

if TYPE_CHECKING:
    from collections.abc import Callable

    from matplotlib.figure import Figure

__all__ = ["render_diagnosis"]


MOST_RUNS = 2
"""Most runs plotted of the main signal; one of every other signal. Chosen."""

MOST_SIGNALS = 6
"""Most signals plotted; chosen so that the page stays small."""

MOST_RANKED = 8
"""Candidates shown per step; the others are folded. Chosen."""

MOST_CURVES = 2
"""Most curves of the missing force plotted, the most informative first. Chosen."""

MODEL_FILE = "model.json"

_SURE = 0.05
"""Fraction of a residual, beyond chance, below which a view is not plotted. Chosen."""


@dataclass(frozen=True, slots=True)
class CauseStory:
    """One cause with title, remarks, table and curve."""

    title: str
    remarks: tuple[tuple[str, str], ...]
    parameters: Table | None
    curve: Picture | None


@dataclass(frozen=True, slots=True)
class StepStory:
    """The candidates of one step: the best, and the rest."""

    title: str
    best: Table
    rest: Table | None


def render_diagnosis(
    diagnosis: Diagnosis, title: str, when: str, directory: str = "", runs: Sequence[Trial] = ()
) -> str:
    """Return the whole page; the same diagnosis gives the same bytes.

    *when* : ISO 8601 moment; *directory* : of the diagnosis, for commands to copy; *runs* : the runs examined, whose
    inputs and tracks are plotted.
    """
    flown = {run.name: run for run in runs}
    headline = verdict_headline(diagnosis)
    before, after = tuple(_before(diagnosis, flown)), tuple(_after(diagnosis, flown))
    first = (next((p for p in after if p.kind == "after"), None) or next(iter(before), None),)
    model_file = f"{directory}/{MODEL_FILE}" if directory else MODEL_FILE
    return render_page(
        "diagnosis/page.html",
        {
            "title": title,
            "when": format_moment(when),
            "headline": headline,
            "verdict": diagnosis.verdict,
            "tiles": _tiles(diagnosis),
            "doubts": tuple(doubt_sentence(d) for d in diagnosis.doubts),
            "base": diagnosis.base_model.base.form.title,
            "lead": lead_sentence(diagnosis),
            "lead_picture": tuple(p for p in first if p is not None),
            "before": tuple(p for p in before if p not in first),
            "track": next(_picture("track", "Track over ground, north up.", lambda: draw_track(flown)), None),
            "numbers_title": "" if diagnosis.numbers is None else numbers_title(diagnosis.numbers),
            "numbers": _numbers(diagnosis.numbers),
            "numbers_gains": _numbers_gains(diagnosis.numbers),
            "signs": diagnosis.gave_away.findings if diagnosis.verdict != "no-effect" else (),
            "views": tuple(_views(diagnosis)),
            "causes": tuple(_causes(diagnosis)),
            "after": tuple(p for p in after if p not in first),
            "hints": tuple(hint_stories(diagnosis)),
            "gains": gains_table(diagnosis.gains) if diagnosis.gains and diagnosis.causes else None,
            "held_out": gain.held_out if (gain := first_gain(diagnosis)) is not None else "",
            "left": diagnosis.left.findings,
            "left_sentence": left_sentence(diagnosis.left),
            "remains": (*_missing(diagnosis.missing), *_left(diagnosis)),
            "steps": tuple(_steps(diagnosis)),
            "cannot_tell": cannot_tell(diagnosis),
            "next": diagnosis.next_manoeuvre,
            "rests_on": rests_on(diagnosis),
            "commands": commands(diagnosis, model_file) if diagnosis.causes or diagnosis.wrong_numbers else (),
        },
    )


def _numbers(numbers: Numbers | None) -> Table | None:
    return numbers_table(numbers) if numbers is not None and numbers.rows else None


def _numbers_gains(numbers: Numbers | None) -> Table | None:
    return gains_table(numbers.gains) if numbers is not None and numbers.gains else None


def _tiles(diagnosis: Diagnosis) -> tuple[tuple[str, str, str], ...]:
    """Return the key figures: (number, label, remark)."""
    tiles = []
    right = None if diagnosis.numbers is None else diagnosis.numbers.gain
    if right is not None:
        name = signal_words(right.signal)
        tiles.append((format_error(right.before, right.unit, 3), "error before", f"{name}, held-out data"))
        tiles.append((format_error(right.after, right.unit, 3), "with corrected numbers", f"{name}, held-out data"))
    gain = diagnosis.gain
    if gain is not None and right is not None:
        gain = next((g for g in diagnosis.gains if g.signal == right.signal), gain)
        if diagnosis.causes:
            words = f"{signal_words(gain.signal)}, held-out data"
            tiles.append((format_error(gain.after, gain.unit, 3), "with the causes included", words))
    elif right is not None:
        interval = interval_words(right)
        tiles.append((format_share(right.ratio), "of the error remains", interval and f"95 %: {interval}"))
    elif gain is not None:
        name = signal_words(gain.signal)
        tiles.append((format_error(gain.before, gain.unit, 3), "error before", f"{name}, held-out data"))
        if diagnosis.causes:
            tiles.append((format_error(gain.after, gain.unit, 3), "error after", f"{name}, held-out data"))
            interval = interval_words(gain)
            tiles.append((format_share(gain.ratio), "of the error remains", interval and f"95 %: {interval}"))
    else:
        error, unit, signal = base_error(diagnosis)
        tiles.append((format_error(error, unit, 3), "error of the simulation", signal_words(signal)))
        noise = diagnosis.noise.get(signal, math.nan)
        tiles.append((format_error(noise, unit, 3), "residual", f"of {signal_words(signal)}, rms"))
    tiles.append((str(diagnosis.tried), "candidates tried", f"in {diagnosis.seconds:.1f} s"))
    return tuple(t for t in tiles if t[0] != "?")


def _picture(name: str, caption: str, draw: Callable[[], Figure | None]) -> Iterator[Picture]:
    with pens(name):
        figure = draw()
        if figure is not None:
            yield Picture(name.split("-")[0], caption, to_svg(figure, name, caption))


def _misfit(trace: Trace) -> float:
    error = trace.measured - trace.fitted
    error = error[np.isfinite(error)]
    return float(np.sqrt(np.mean(error**2))) if len(error) else 0.0


def _shown(portraits: tuple[Portrait, ...]) -> Iterator[Trace]:
    """Yield the traces to plot: the worst few of the first signal, the worst one of each other."""
    for k, portrait in enumerate(portraits[:MOST_SIGNALS]):
        worst = sorted((t for t in portrait.traces if len(t.t) > 1), key=_misfit, reverse=True)
        yield from worst[: MOST_RUNS if k == 0 else 1]


def _ordered(diagnosis: Diagnosis, portraits: tuple[Portrait, ...]) -> tuple[Portrait, ...]:
    """Return the portraits, that of the main signal first."""
    first = first_gain(diagnosis)
    return tuple(sorted(portraits, key=lambda p: first is None or p.signal != first.signal))


def _drawn(diagnosis: Diagnosis, flown: Mapping[str, Trial], before: Trace, after: Trace | None = None) -> Figure:
    run = flown.get(before.run)
    return draw_flight(before, after, run, inputs_of(diagnosis.base_model, run))


def _before(diagnosis: Diagnosis, flown: Mapping[str, Trial]) -> Iterator[Picture]:
    for i, trace in enumerate(_shown(_ordered(diagnosis, diagnosis.before)), start=1):
        caption = (
            f"'{trace.run}', {signal_words(trace.signal)}: measurement, and simulation with the same commands. "
            f"Below: the error, {format_error(_misfit(trace), trace.unit, 3)} RMS."
        )
        if diagnosis.after and i > 1:
            return
        yield from _picture(f"before-{i}", caption, lambda trace=trace: _drawn(diagnosis, flown, trace))  # type: ignore[misc]


def _after(diagnosis: Diagnosis, flown: Mapping[str, Trial]) -> Iterator[Picture]:
    if not diagnosis.after:
        return
    gains = diagnosis.gains if diagnosis.causes or diagnosis.numbers is None else diagnosis.numbers.gains
    yield from _picture(
        "gains-1",
        "Remaining error per signal with its 95 % interval; left of the line is better.",
        lambda: draw_gains(gains),
    )
    extended = {(t.run, t.signal): t for p in diagnosis.after for t in p.traces}
    for i, trace in enumerate(_shown(_ordered(diagnosis, diagnosis.before)), start=1):
        other = extended.get((trace.run, trace.signal))
        if other is None:
            continue
        old, new = (format_error(_misfit(t), t.unit, 3) for t in (trace, other))
        caption = f"'{trace.run}', {signal_words(trace.signal)}: {old} RMS before, {new} RMS after."
        yield from _picture(f"after-{i}", caption, lambda a=trace, b=other: _drawn(diagnosis, flown, a, b))  # type: ignore[misc]


def _views(diagnosis: Diagnosis) -> Iterator[Picture]:
    """Yield per cause the view of the residual that shows it, if any; without causes the strongest views."""
    if diagnosis.verdict == "no-effect":
        return
    views: list[tuple[View, str]] = []
    for cause in diagnosis.causes:
        view = telling_view(diagnosis.before, EFFECTS.get(cause.effect.slug), cause.effect.place)
        if (
            view is not None
            and view.share > _SURE
            and all(view.name != v.name or view.kind != v.kind for v, _ in views)
        ):
            views.append((view, effect_words(cause.effect.slug)))
    if not diagnosis.causes:
        every = sorted((v for p in diagnosis.before for v in views_of(p)), key=lambda v: v.share, reverse=True)
        views = [(v, "") for v in every[:MOST_RUNS] if v.share > _SURE]
    for i, (view, slug) in enumerate(views, start=1):
        after = next((p for p in diagnosis.after if p.signal == view.portrait.signal), None) if slug else None
        caption = _view_caption(view, slug)
        yield from _picture(f"view-{i}", caption, lambda view=view, after=after: draw_view(view, after))  # type: ignore[misc]


def _view_caption(view: View, cause: str) -> str:
    what = f"Simulation error of the {signal_words(view.portrait.signal)} "
    share = format_share(view.share)
    if view.kind == "spectrum":
        how = f"over frequency: {share} of it is concentrated at one frequency, beyond an even spread."
    elif view.kind == "cross":
        how = f"correlated with earlier {signal_words(view.name)}: up to {share} of it."
    else:
        channel = "time" if view.name == "time" else signal_words(view.name)
        how = f"over {channel}: {share} of it is correlated; noise would scatter evenly about the line."
    return what + how + (f" This indicates {cause}." if cause else "")


def _causes(diagnosis: Diagnosis) -> Iterator[CauseStory]:
    for i, cause in enumerate(diagnosis.causes, start=1):
        table = cause_table(cause) if cause.parameters else None
        yield CauseStory(cause_title(diagnosis, cause), cause_remarks(diagnosis, cause), table, _curve(cause, i))


def _curve(cause: Cause, i: int) -> Picture | None:
    curve = cause.curve
    if curve is None or len(curve.x) < 2 or not np.isfinite(curve.y).any():
        return None
    caption = f"Identified: {curve.title}."
    if curve.polar:
        caption += " In the polar plot the dark circle is zero; outside is positive."
    return next(_picture(f"curve-{i}", caption, lambda: draw_curve(curve)), None)


def _left(diagnosis: Diagnosis) -> Iterator[Picture]:
    for i, portrait in enumerate(_ordered(diagnosis, diagnosis.after or diagnosis.before)[:MOST_RUNS], start=1):
        caption = (
            f"Residual of the {signal_words(portrait.signal)}: autocorrelation (noise: inside the grey band) and "
            "spectrum (noise: evenly spread)."
        )
        yield from _picture(f"left-{i}", caption, lambda portrait=portrait: draw_left(portrait))  # type: ignore[misc]


def _missing(missing: MissingForce | None) -> Iterator[Picture]:
    if missing is None:
        return
    for i, curve in enumerate(tuple(missing.curves.values())[:MOST_CURVES], start=1):
        told = f"{format_share(curve.share)} of it" if curve.share > 0.0 else "none of it"
        caption = (
            f"Missing force without an identified cause, over {missing_over(curve)}: "
            f"the curve of {curve.predicted_by} predicts {told}."
        )
        yield from _picture(f"missing-{i}", caption, lambda curve=curve: draw_missing(missing, curve))  # type: ignore[misc]


def _steps(diagnosis: Diagnosis) -> Iterator[StepStory]:
    for heading, ranked in steps_of(diagnosis):
        best, rest = (ranking_table(r) for r in (ranked[:MOST_RANKED], ranked[MOST_RANKED:]))
        yield StepStory(heading, best, rest if rest.rows else None)
