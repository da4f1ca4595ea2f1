"""The report of an identification, of a complete study or a single fit. One function per section."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from functools import partial
from typing import Any

import numpy as np

from gcs_autotune.identify import Fit, Method, Model, Trace, Validation, is_of_one_axis
from gcs_autotune.report.study.figures import convergence_of, draw_convergence, draw_correlation, draw_methods
from gcs_autotune.report.study.study import (
    MethodOutcome,
    Study,
    comparison_sentences,
    structure_title,
    unseen_remarks,
    verdict_of,
)
from gcs_autotune.report.study.tables import (
    choice_table,
    estimate_tables,
    method_table,
    parameter_table,
    proposal_table,
    run_table,
    unseen_table,
)
from gcs_autotune.report.toolkit.axis_fit import damping_parts
from gcs_autotune.report.toolkit.document import (
    IN_RESULT,
    Document,
    Figure,
    KeyFigure,
    Note,
    Section,
    Table,
    bullets,
    sections_of,
)
from gcs_autotune.report.toolkit.figures import INTERVALS_CAPTION, draw_fit, draw_intervals, draw_track
from gcs_autotune.report.toolkit.wording import (
    contradictions_in,
    format_moment,
    format_percent,
    remarks,
)
from gcs_autotune.rounding import counted

__all__ = ["damping_section", "fit_document", "method_list", "model_section", "precision_section", "study_document"]


MOST_TRACES = 12
"""Largest number of traces plotted of each kind, so that the page stays small. Project choice."""

_HOW_TO_READ_STD = (
    "Rounded to the standard error. The bound (Cramér-Rao) is the smallest standard error of any unbiased method on "
    "these runs. A ratio std / bound near 1 means that the fit uses all information. A larger ratio means that the "
    "residuals are not white, or that the model needs more terms."
)


_HOW_TO_READ_ERRORS = (
    "Rms error: of the prediction of held-out data. The residual is the misfit to the data used for the fit. "
    "`diagnose` may hold out other data and starts without a constant force, so its errors can differ."
)


def study_document(study: Study) -> Document:
    """Return the report of an identification. In JSON it is the selected fit with its validation."""
    fit, unseen = study.fit, study.answer.unseen
    return Document(
        title=study.title,
        when=format_moment(study.when),
        verdict=verdict_of(fit, unseen),
        key_figures=tuple(_key_figures(fit, unseen)),
        contradictions=contradictions_in(fit.doubts),
        doubts=remarks(fit.doubts),
        sections=sections_of(FRONT, SECTIONS, study),
        facts=fit.to_dict(),
    )


def fit_document(fit: Fit[Model]) -> Document:
    """Return the report of a single fit of any model form."""
    return Document(
        title=structure_title(fit),
        verdict=verdict_of(fit),
        contradictions=contradictions_in(fit.doubts),
        doubts=remarks(fit.doubts),
        sections=(model_section(fit), *damping_section(fit), precision_section(fit)),
        facts=fit.to_dict(),
    )


def model_section(fit: Fit[Model], slug: str = "model") -> Section:
    """Return the section with the parameters of a fit."""
    parts = (parameter_table(fit), Note(_HOW_TO_READ_STD, kind="quiet"))
    return Section(slug, structure_title(fit), parts, facts=IN_RESULT)


def precision_section(fit: Fit[Model], slug: str = "model") -> Section:
    """Return the folded section with the figures of the uncertainty of a fit. *slug*: that of its model section."""
    correlation = Figure(
        f"{slug}-correlation",
        "Correlation of the estimates. Near ±1 the runs do not distinguish the two parameters.",
        partial(draw_correlation, fit),
    )
    intervals = Figure(f"{slug}-intervals", INTERVALS_CAPTION, partial(draw_intervals, fit.parameters))
    title = f"Correlation and intervals of {fit.dof}"
    return Section(f"{slug}-precision", title, (correlation, intervals), detail=True, facts=IN_RESULT, folded=True)


def _key_figures(fit: Fit[Model], unseen: Validation | None) -> Iterator[KeyFigure]:
    fitted = [p for p in fit.parameters.values() if p.status in ("fitted", "at_bound")]
    yield KeyFigure(format_percent(fit.fit_percent), "fit", "simulated over the identification runs")
    if unseen is not None:
        yield KeyFigure(format_percent(unseen.fit_percent), "prediction", "held-out data")
    yield KeyFigure(str(len(fitted)), "parameters", f"from {counted(len(fit.used), 'run')}")
    known = [100.0 * p.std / abs(p.value) for p in fitted if p.value and np.isfinite(p.std)]
    if known:
        yield KeyFigure(format_percent(float(np.median(known))), "standard error", "median of the parameters")


def _model(study: Study) -> Iterator[Section]:
    yield model_section(study.fit)
    yield precision_section(study.fit)


def _unseen(study: Study) -> Iterator[Section]:
    answer = study.answer
    if not study.how_unseen:
        return
    traces = () if answer.unseen is None else answer.unseen.traces[:MOST_TRACES]
    yield Section(
        "unseen",
        "Held-out prediction",
        (
            Note(study.how_unseen),
            unseen_table(answer.unseen, study.fit.dof),
            Note("" if answer.unseen is None else _HOW_TO_READ_ERRORS),
            *(Note(remark) for remark in unseen_remarks(answer)),
            *(_trace(study, t, f"unseen-{i}", f"Held-out prediction of '{t.run}'.") for i, t in enumerate(traces, 1)),
        ),
        facts=IN_RESULT
        if answer.unseen is None
        else {"validation": {"how": study.how_unseen, **answer.unseen.to_dict()}},
    )


def _trace(study: Study, trace: Trace, name: str, caption: str) -> Figure:
    run = next((trial for trial in study.trials if trial.name == trace.run), None)
    return Figure(name, caption, partial(draw_fit, trace, run, study.fit.model))


def damping_section(fit: Fit[Model], *, detail: bool = False) -> Iterator[Section]:
    """Yield notes and tables that explain how the damping of one axis was chosen."""
    if is_of_one_axis(fit) and (parts := damping_parts(fit)):
        yield Section("damping", "Choice of damping", parts, detail, facts=IN_RESULT)


def _structure(study: Study) -> Iterator[Section]:
    """Yield the choice of structure by held-out data, and the choice of the damping by the fits."""
    if not study.choice:
        yield from damping_section(study.fit)
        return
    rows = [list(row) for row in study.choice]
    yield Section(
        "structure",
        "Choice of structure",
        (Note(study.choice_verdict), choice_table(study), *damping_section(study.fit, detail=True)),
        facts={"structure_choice": {"verdict": study.choice_verdict, "rows": rows}},
    )


def _methods(study: Study) -> Iterator[Section]:
    if len(study.outcomes) < 2:
        return
    fits = [outcome.fit for outcome in study.outcomes if outcome.fit is not None]
    yield Section(
        "methods",
        "Comparison of methods",
        (
            method_table(study),
            *estimate_tables(study),
            Figure(
                "methods",
                "Estimates of each method relative to those of the selected method, with 95 % intervals.",
                partial(draw_methods, study.fit, fits),
            ),
        ),
        facts={"methods": {outcome.method: _outcome(outcome) for outcome in study.outcomes}},
    )


def _outcome(outcome: MethodOutcome) -> dict[str, Any]:
    if outcome.fit is None:
        return {"refused": outcome.refusal}
    data = outcome.fit.to_dict()
    kept = {k: data[k] for k in ("structure", "parameters", "fit_percent", "doubts", "model")}
    unseen = None if outcome.unseen is None else outcome.unseen.fit_percent
    return {**kept, "seconds": outcome.seconds, "unseen_fit_percent": unseen}


def _not_distinguished(study: Study) -> Iterator[Section]:
    if study.not_distinguished:
        facts = {"cannot_tell": list(study.not_distinguished)}
        yield Section(
            "cannot-tell", "What these runs do not determine", tuple(bullets(study.not_distinguished)), facts=facts
        )


def _comparison(study: Study) -> Iterator[Section]:
    if study.comparisons:
        facts = {"comparison": {"with": study.compared_with, "dofs": [c.to_dict() for c in study.comparisons]}}
        said = tuple(bullets(comparison_sentences(study)))
        yield Section("comparison", f"Comparison with {study.compared_with}", said, facts=facts)


def _intervals(study: Study) -> Iterator[Section]:
    if study.intervals:
        facts = {"intervals": list(study.intervals)}
        yield Section("intervals", "Intervals by profile likelihood", tuple(bullets(study.intervals)), facts=facts)


def _next(study: Study) -> Iterator[Section]:
    if study.proposals:
        rows = [list(row) for row in study.proposals]
        yield Section(
            "next",
            "What to fly next",
            (Note(study.proposal_verdict), proposal_table(study)),
            facts={"plan_next": {"verdict": study.proposal_verdict, "rows": rows}},
        )


def _fit(study: Study) -> Iterator[Section]:
    caption = "Model and measurement of '{}', with the 95 % band. Below: residual and input."
    figures = (
        _trace(study, trace, f"fit-{i}", caption.format(trace.run))
        for i, trace in enumerate(study.fit.traces[:MOST_TRACES], start=1)
    )
    yield Section("fit", "Model and measurement", tuple(figures), facts=IN_RESULT)


def _track(study: Study) -> Iterator[Section]:
    draw = partial(draw_track, {trial.name: trial for trial in study.trials})
    yield Section("track", "Track", (Figure("track", "Track over ground, north up.", draw),), facts=IN_RESULT)


def _more(study: Study) -> Iterator[Section]:
    figures = (Figure(f"more-{i}", caption, draw) for i, (caption, draw) in enumerate(study.figures, start=1))
    yield Section("more", "More figures", tuple(figures), facts=IN_RESULT)


def _convergence(study: Study) -> Iterator[Section]:
    caption = (
        "Estimates{} over time with their 95 % intervals, and the result (dashed). A repeated pass starts near the "
        "result. --option passes=1 shows the first pass."
    )
    figures = (
        Figure(
            f"convergence-{i}",
            caption.format(f" during '{run}'" if run else ""),
            partial(draw_convergence, study.fit, history),
        )
        for i, (run, history) in enumerate(convergence_of(study.fit)[:MOST_TRACES], start=1)
    )
    yield Section("convergence", "Convergence of the parameters", tuple(figures), facts=IN_RESULT)


def _runs(study: Study) -> Iterator[Section]:
    yield Section("runs", "Runs", (run_table(study),), detail=True, facts=IN_RESULT)


FRONT = (_model, _unseen, _structure, _not_distinguished, _fit, _next)
"""Functions that return the sections that a reader sees first."""

SECTIONS = (_methods, _comparison, _intervals, _convergence, _track, _more, _runs)
"""Functions that return all other sections, folded on the page. To add a section, add its function here."""


def method_list(methods: Iterable[Method]) -> Document:
    """Return the list of all identification methods, with the kinds of models and the options of each."""
    rows = []
    for m in methods:
        kinds = " and ".join(k for k, there in (("one axis", m.axis), ("coupled", m.coupled)) if there is not None)
        rows.append((m.name, kinds, m.summary))
        rows.extend(("", "", f"{name}: {text}") for name, text in m.options)
    table = Table(("method", "fits", "what; options"), "lll", tuple(rows))
    return Document("Methods", (Section("methods", "Identification methods", (table,)),))
