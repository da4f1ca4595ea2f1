"""The report of a diagnosis, with one function per section."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial

import numpy as np

from gcs_autotune.diagnose import Cause, Diagnosis, Portrait
from gcs_autotune.documents import MODEL
from gcs_autotune.effects import EFFECTS, effect_words
from gcs_autotune.identify import Trace
from gcs_autotune.report.diagnosis.cause_wording import cause_notes, cause_title, not_distinguished
from gcs_autotune.report.diagnosis.figures import (
    View,
    draw_curve,
    draw_flight,
    draw_gains,
    draw_left,
    draw_missing,
    draw_view,
    most_informative_view,
    views_of,
)
from gcs_autotune.report.diagnosis.lead import hint_notes, hint_title, lead_sentence
from gcs_autotune.report.diagnosis.tables import (
    cause_table,
    gains_table,
    numbers_table,
    ranking_table,
    steps_of,
)
from gcs_autotune.report.diagnosis.wording import (
    base_error,
    commands,
    first_gain,
    interval_words,
    is_noise,
    left_sentence,
    missing_over,
    numbers_title,
    rests_on,
    signal_words,
    verdict_of,
)
from gcs_autotune.report.toolkit.document import (
    IN_RESULT,
    Document,
    Figure,
    KeyFigure,
    Note,
    Part,
    Section,
    bullets,
    notes,
    sections_of,
)
from gcs_autotune.report.toolkit.figures import draw_track, inputs_of
from gcs_autotune.report.toolkit.wording import (
    UNKNOWN,
    contradictions_in,
    format_error,
    format_moment,
    format_share,
    remarks,
    sentence,
)
from gcs_autotune.trial import Trial

__all__ = ["diagnosis_document"]


MOST_RUNS = 2
"""Largest number of runs plotted for the main signal. For every other signal one run is plotted. Project choice."""

MOST_SIGNALS = 6
"""Largest number of signals plotted, so that the page stays small. Project choice."""

MOST_CURVES = 2
"""Largest number of curves of the missing force plotted, the most informative first. Project choice."""

_SURE = 0.05
"""Fraction of a residual, beyond chance, below which a view is not plotted. Project choice."""


@dataclass(frozen=True, slots=True, eq=False)
class _Examined:
    """A diagnosis, the runs examined by name, and the file of the extended model."""

    diagnosis: Diagnosis
    flown: Mapping[str, Trial] = field(default_factory=dict)
    model_file: str = MODEL


def diagnosis_document(
    diagnosis: Diagnosis, title: str = "Diagnosis", when: str = "", directory: str = "", runs: Sequence[Trial] = ()
) -> Document:
    """Return the report of a diagnosis.

    when : date and time of the diagnosis, ISO 8601. directory : folder of the diagnosis, for commands to copy.
    runs : the runs examined. Their inputs and tracks are plotted.
    """
    model_file = f"{directory}/{MODEL}" if directory else MODEL
    examined = _Examined(diagnosis, {run.name: run for run in runs}, model_file)
    return Document(
        title=title,
        when=format_moment(when),
        badge=diagnosis.verdict.replace("-", " "),
        verdict=verdict_of(diagnosis),
        lead=lead_sentence(diagnosis),
        lead_figures=(_after(examined) or _before(examined))[:1],
        key_figures=tuple(k for k in _key_figures(diagnosis) if k.number != UNKNOWN),
        contradictions=contradictions_in(diagnosis.doubts),
        doubts=remarks(diagnosis.doubts) or None,
        sections=sections_of(FRONT, SECTIONS, examined),
        facts=diagnosis.to_dict(),
    )


def _key_figures(diagnosis: Diagnosis) -> Iterator[KeyFigure]:
    right = None if diagnosis.numbers is None else diagnosis.numbers.gain
    gain = diagnosis.gain
    first = gain if right is None else right
    if first is None:
        error, unit, signal = base_error(diagnosis)
        yield KeyFigure(format_error(error, unit, 3), "error of the simulation", signal_words(signal))
        noise = diagnosis.noise.get(signal, math.nan)
        yield KeyFigure(format_error(noise, unit, 3), "residual", f"of {signal_words(signal)}, rms")
    else:
        where = f"{signal_words(first.signal)}, held-out data"
        remains = KeyFigure(
            format_share(first.ratio),
            "of the error remains",
            f"95 %: {interval}" if (interval := interval_words(first)) else "",
        )
        yield KeyFigure(format_error(first.before, first.unit, 3), "error before", where)
        if right is not None:
            yield KeyFigure(format_error(right.after, right.unit, 3), "with corrected numbers", where)
            if gain is None:
                yield remains
            elif diagnosis.causes:
                same = next((g for g in diagnosis.gains if g.signal == right.signal), gain)
                where = f"{signal_words(same.signal)}, held-out data"
                yield KeyFigure(format_error(same.after, same.unit, 3), "with the causes included", where)
        elif diagnosis.causes:
            yield KeyFigure(format_error(first.after, first.unit, 3), "error after", where)
            yield remains
    yield KeyFigure(str(diagnosis.tried), "candidates tried", f"in {diagnosis.seconds:.1f} s")


# -- sections


def _simulation(examined: _Examined) -> Iterator[Section]:
    diagnosis, after = examined.diagnosis, _after(examined)
    figures = [f for f in _before(examined) if after or f.name != "before-1"]  # else it stands beside the lead
    if not figures:
        return
    yield Section(
        "before",
        f"{'Before: simulation' if after else 'Simulation'} and measurement",
        (
            Note(
                f"The simulation ({diagnosis.base_model.base.form.title}) uses the recorded commands as its only input."
            ),
            *figures,
            Figure("track", "Track over ground, north up.", partial(draw_track, examined.flown)),
        ),
        detail=True,
        facts=IN_RESULT,
    )


def _numbers(examined: _Examined) -> Iterator[Section]:
    numbers, first = examined.diagnosis.numbers, first_gain(examined.diagnosis)
    if numbers is None or not numbers.rows:
        return
    held_out = f"Held out: {first.held_out}. Errors before any cause is added." if first is not None else ""
    gains = (gains_table(numbers.gains), Note(held_out if numbers.gains else "", kind="quiet"))
    improvement = Section("numbers-gains", "Improvement by the corrected numbers, on held-out data", gains)
    yield Section("numbers", numbers_title(numbers), (numbers_table(numbers), improvement), facts=IN_RESULT)


def _evidence(examined: _Examined) -> Iterator[Section]:
    diagnosis = examined.diagnosis
    if diagnosis.verdict != "no-effect":
        parts: tuple[Part, ...] = (*bullets(diagnosis.gave_away.findings), *_views(diagnosis))
        yield Section("signs", "Evidence", parts, detail=True, facts=IN_RESULT)


def _causes(examined: _Examined) -> Iterator[Section]:
    for i, cause in enumerate(examined.diagnosis.causes, start=1):
        parts: tuple[Part, ...] = (*cause_notes(examined.diagnosis, cause), cause_table(cause), *_curve(cause, i))
        yield Section(f"cause-{i}", cause_title(examined.diagnosis, cause), parts, facts=IN_RESULT)


_UNLIKE_IDENTIFY = (
    "Before: the simulation without these causes. `identify` fits a constant force and may hold out other data, so "
    "its held-out error can differ."
)


def _improvement(examined: _Examined) -> Iterator[Section]:
    diagnosis = examined.diagnosis
    gains = diagnosis.gains if diagnosis.causes else ()
    figures = _after(examined)[1:] if diagnosis.after else ()
    if not gains and not figures:
        return
    first = first_gain(diagnosis)
    how = "The table shows held-out data. The figures show the runs used for the fit."
    held_out = f"Held out: {first.held_out}. {how}" if first is not None and first.held_out else ""
    parts: tuple[Part, ...] = (
        gains_table(gains),
        Note(_UNLIKE_IDENTIFY if gains else ""),
        Note(held_out, kind="quiet"),
        *_gains_figure(diagnosis),
        *figures,
    )
    yield Section("after", "Improvement on held-out data", parts, facts=IN_RESULT)


def _hints(examined: _Examined) -> Iterator[Section]:
    hints = tuple(
        Section(f"hint-{i}", f"{i}. {hint_title(hint)}", hint_notes(examined.diagnosis, hint))
        for i, hint in enumerate(examined.diagnosis.hints, start=1)
    )
    yield Section("hints", "Hints: possible causes that these runs do not establish", hints, facts=IN_RESULT)


_RESIDUALS = {
    True: "The residual cannot be distinguished from noise.",
    False: "The residual is correlated, but no single property of it stands out.",
}
"""Whether a residual counts as noise -> sentence on it, if nothing else about it is reported."""


def _remains(examined: _Examined) -> Iterator[Section]:
    diagnosis = examined.diagnosis
    findings = diagnosis.left.findings
    parts: tuple[Part, ...] = (
        *bullets(findings),
        Note("" if findings else _RESIDUALS[is_noise(diagnosis.left)]),
        Note(left_sentence(diagnosis.left)),
        *_missing(diagnosis),
        *_left(diagnosis),
    )
    yield Section("left", "Remaining error", parts, facts=IN_RESULT)


def _not_distinguished(examined: _Examined) -> Iterator[Section]:
    groups = tuple(bullets(not_distinguished(examined.diagnosis)))
    yield Section("cannot-tell", "Causes that these runs do not distinguish", groups, facts=IN_RESULT)


def _next(examined: _Examined) -> Iterator[Section]:
    manoeuvre = Note(sentence(examined.diagnosis.next_manoeuvre))
    yield Section("next", "What to fly next", (manoeuvre,), facts=IN_RESULT)


_HOW_TO_READ_RANKING = (
    "Gain: reduction of the held-out error by a candidate. p: probability of such a gain by chance, corrected for the "
    "number of candidates. Evidence: twice the log-likelihood gained, minus the penalty for its parameters."
)


def _ranking(examined: _Examined) -> Iterator[Section]:
    steps = (
        Section(f"ranking-{i}", heading, (ranking_table(ranked),))
        for i, (heading, ranked) in enumerate(steps_of(examined.diagnosis), start=1)
    )
    if examined.diagnosis.ranking:
        parts: tuple[Part, ...] = (Note(_HOW_TO_READ_RANKING, kind="quiet"), *steps)
        yield Section("ranking", "Candidates tried", parts, detail=True, facts=IN_RESULT)


def _use(examined: _Examined) -> Iterator[Section]:
    diagnosis = examined.diagnosis
    if diagnosis.causes or diagnosis.wrong_numbers:
        lines = tuple(commands(diagnosis, examined.model_file))
        yield Section("use", "How to use the model", lines, detail=True, facts=IN_RESULT)


def _basis(examined: _Examined) -> Iterator[Section]:
    yield Section("rests-on", "Basis of this result", tuple(notes(rests_on(examined.diagnosis))), facts=IN_RESULT)


FRONT = (_numbers, _causes, _improvement, _not_distinguished, _hints, _next, _use)
"""Functions that return the sections that a reader sees first."""

SECTIONS = (_simulation, _evidence, _remains, _ranking, _basis)
"""Functions that return all other sections, folded on the page. To add a section, add its function here."""


# -- figures


def _misfit(trace: Trace) -> float:
    error = trace.measured - trace.fitted
    error = error[np.isfinite(error)]
    return float(np.sqrt(np.mean(error**2))) if len(error) else 0.0


def _shown(portraits: tuple[Portrait, ...]) -> Iterator[Trace]:
    """Yield the traces to plot: the worst few of the first signal, and the worst one of each other signal."""
    for k, portrait in enumerate(portraits[:MOST_SIGNALS]):
        worst = sorted((t for t in portrait.traces if len(t.t) > 1), key=_misfit, reverse=True)
        yield from worst[: MOST_RUNS if k == 0 else 1]


def _ordered(diagnosis: Diagnosis, portraits: tuple[Portrait, ...]) -> tuple[Portrait, ...]:
    """Return the portraits, with that of the main signal first."""
    first = first_gain(diagnosis)
    return tuple(sorted(portraits, key=lambda p: first is None or p.signal != first.signal))


def _flight(examined: _Examined, name: str, caption: str, before: Trace, after: Trace | None = None) -> Figure:
    run = examined.flown.get(before.run)
    inputs = inputs_of(examined.diagnosis.base_model, run)
    return Figure(name, caption, partial(draw_flight, before, after, run, inputs))


def _before(examined: _Examined) -> tuple[Figure, ...]:
    """Plot measurement and simulation. If other figures compare it with the extended model, only one is plotted."""
    diagnosis = examined.diagnosis
    figures = tuple(
        _flight(
            examined,
            f"before-{i}",
            f"'{trace.run}', {signal_words(trace.signal)}: measurement, and simulation with the same commands. "
            f"Below: the error, {format_error(_misfit(trace), trace.unit, 3)} RMS.",
            trace,
        )
        for i, trace in enumerate(_shown(_ordered(diagnosis, diagnosis.before)), start=1)
    )
    return figures[:1] if diagnosis.after else figures


def _after(examined: _Examined) -> tuple[Figure, ...]:
    """Plot measurement, simulation and extended model."""
    diagnosis = examined.diagnosis
    extended = {(t.run, t.signal): t for p in diagnosis.after for t in p.traces}
    figures = []
    for i, trace in enumerate(_shown(_ordered(diagnosis, diagnosis.before)), start=1):
        other = extended.get((trace.run, trace.signal))
        if other is not None:
            old, new = (format_error(_misfit(t), t.unit, 3) for t in (trace, other))
            caption = f"'{trace.run}', {signal_words(trace.signal)}: {old} RMS before, {new} RMS after."
            figures.append(_flight(examined, f"after-{i}", caption, trace, other))
    return tuple(figures)


def _gains_figure(diagnosis: Diagnosis) -> Iterator[Figure]:
    gains = diagnosis.gains if diagnosis.causes or diagnosis.numbers is None else diagnosis.numbers.gains
    if diagnosis.after:
        caption = "Remaining error of each signal with its 95 % interval. Left of the line the error has fallen."
        yield Figure("gains", caption, partial(draw_gains, gains))


def _views(diagnosis: Diagnosis) -> Iterator[Figure]:
    """Yield the view of the residual that shows each cause, if there is one.

    Without causes, yield the strongest views.
    """
    views: list[tuple[View, str]] = []
    for cause in diagnosis.causes:
        view = most_informative_view(diagnosis.before, EFFECTS.get(cause.effect.slug), cause.effect.place)
        is_new = view is not None and all((view.name, view.kind) != (v.name, v.kind) for v, _ in views)
        if view is not None and is_new and view.share > _SURE:
            views.append((view, effect_words(cause.effect.slug)))
    if not diagnosis.causes:
        every = sorted((v for p in diagnosis.before for v in views_of(p)), key=lambda v: v.share, reverse=True)
        views = [(v, "") for v in every[:MOST_RUNS] if v.share > _SURE]
    for i, (view, name) in enumerate(views, start=1):
        after = next((p for p in diagnosis.after if p.signal == view.portrait.signal), None) if name else None
        yield Figure(f"view-{i}", _view_caption(view, name), partial(draw_view, view, after))


def _view_caption(view: View, cause: str) -> str:
    what = f"Simulation error of the {signal_words(view.portrait.signal)} "
    share = format_share(view.share)
    if view.kind == "spectrum":
        how = f"over frequency: {share} of its variance is at one frequency, above that of an even spread."
    elif view.kind == "cross":
        how = f"correlated with earlier {signal_words(view.name)}: up to {share} of its variance."
    else:
        channel = "time" if view.name == "time" else signal_words(view.name)
        how = f"over {channel}, which explains {share} of its variance. Noise would scatter evenly about the line."
    return what + how + (f" This indicates {cause}." if cause else "")


def _curve(cause: Cause, i: int) -> Iterator[Figure]:
    curve = cause.curve
    if curve is None or len(curve.x) < 2 or not np.isfinite(curve.y).any():
        return
    polar = " In the polar plot the dark circle marks zero. Values outside it are positive." if curve.polar else ""
    yield Figure(f"curve-{i}", f"Identified: {curve.title}.{polar}", partial(draw_curve, curve))


def _left(diagnosis: Diagnosis) -> Iterator[Figure]:
    for i, portrait in enumerate(_ordered(diagnosis, diagnosis.after or diagnosis.before)[:MOST_RUNS], start=1):
        caption = (
            f"Residual of the {signal_words(portrait.signal)}: autocorrelation (noise: inside the grey band) and "
            "spectrum (noise: evenly spread)."
        )
        yield Figure(f"left-{i}", caption, partial(draw_left, portrait))


def _missing(diagnosis: Diagnosis) -> Iterator[Figure]:
    missing = diagnosis.missing
    curves = () if missing is None else tuple(missing.curves.values())[:MOST_CURVES]
    for i, curve in enumerate(curves, start=1):
        share = f"{format_share(curve.share)} of its power" if curve.share > 0.0 else "none of it"
        caption = (
            f"Missing force without an identified cause, over {missing_over(curve)}. "
            f"The curve from {curve.predicted_by} predicts {share}."
        )
        assert missing is not None
        yield Figure(f"missing-{i}", caption, partial(draw_missing, missing, curve))
