"""The page of an identification: one self-contained HTML file that opens offline."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from gcs_autotune.identify import AxisFit, Trace
from gcs_autotune.report.study.study import (
    Study,
    comparison_sentences,
    structure_title,
    unseen_remarks,
    verdict_headline,
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
from gcs_autotune.report.toolkit.axis_fit import candidate_table, decision_sentence
from gcs_autotune.report.toolkit.canvas import AFTER, BEFORE, FAINT, INK, WANTED, legend, new_axes, pens, to_svg
from gcs_autotune.report.toolkit.figures import INTERVALS_CAPTION, draw_fit, draw_intervals, draw_track
from gcs_autotune.report.toolkit.page import Picture, render_page
from gcs_autotune.report.toolkit.wording import doubt_sentence, format_moment, format_percent

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["render_study"]


MOST_TRACES = 12
"""Most traces plotted of each kind; chosen so that the page stays small."""

DEEPEST = 0.7
"""Opacity of the cell of a fully correlated pair; its number stays legible on light and dark pages."""

_COLOURS = (AFTER, BEFORE, WANTED, "#cc79a7", "#e69f00", "#56b4e9", FAINT)


def render_study(study: Study) -> str:
    """Return the whole page; the same study gives the same bytes."""
    return render_page("study/page.html", _context(study))


def _context(study: Study) -> dict[str, Any]:
    fit, answer = study.fit, study.answer
    axis = fit if isinstance(fit, AxisFit) else None
    pictures = list(_pictures(study))
    return {
        "study": study,
        "headline": verdict_headline(study),
        "when": format_moment(study.when),
        "tiles": _tiles(study),
        "doubts": tuple(doubt_sentence(d) for d in fit.doubts),
        "model_title": structure_title(fit),
        "parameters": parameter_table(fit),
        "runs": run_table(study),
        "unseen": unseen_table(answer.unseen, fit.dof),
        "unseen_remarks": unseen_remarks(answer),
        "decision": "" if axis is None or axis.decision is None else decision_sentence(axis),
        "candidates": candidate_table(axis) if axis is not None and axis.candidates else None,
        "choice": choice_table(study) if study.choice else None,
        "methods": method_table(study) if len(study.outcomes) > 1 else None,
        "estimates": estimate_tables(study) if len(study.outcomes) > 1 else (),
        "comparisons": comparison_sentences(study),
        "proposals": proposal_table(study) if study.proposals else None,
        "pictures": {
            kind: [p for p in pictures if p.kind == kind] for kind in ("fit", "unseen", "model", "extra", "track")
        },
    }


def _tiles(study: Study) -> tuple[tuple[str, str, str], ...]:
    fit, answer = study.fit, study.answer
    fitted = [p for p in fit.parameters.values() if p.status in ("fitted", "at_bound")]
    tiles = [(format_percent(fit.fit_percent), "fit", "free run, identification runs")]
    if answer.unseen is not None:
        tiles.append((format_percent(answer.unseen.fit_percent), "prediction", "held-out data"))
    tiles.append((str(len(fitted)), "parameters", f"from {len(fit.used)} run{'s' if len(fit.used) > 1 else ''}"))
    known = [100.0 * p.std / abs(p.value) for p in fitted if p.value and np.isfinite(p.std)]
    if known:
        tiles.append((format_percent(float(np.median(known))), "standard error", "median of the parameters"))
    return tuple(tiles)


def _pictures(study: Study) -> Iterator[Picture]:
    answer = study.answer
    for i, trace in enumerate(study.fit.traces[:MOST_TRACES], start=1):
        caption = f"Model and measurement of '{trace.run}', with the 95 % band. Below: residual and input."
        yield from _picture("fit", i, caption, _trace(trace, study))
    unseen = () if answer.unseen is None else answer.unseen.traces
    for i, trace in enumerate(unseen[:MOST_TRACES], start=1):
        caption = f"Held-out prediction of '{trace.run}'."
        yield from _picture("unseen", i, caption, _trace(trace, study))
    if len([p for p in study.fit.parameters.values() if p.std > 0.0]) > 2:
        caption = "Correlation of the estimates. These runs do not separate pairs near ±1."
        yield from _picture("model", 1, caption, _correlation(study))
    intervals = _plain("intervals", lambda: draw_intervals(study.fit.parameters))
    yield from _picture("model", 3, INTERVALS_CAPTION, intervals)
    track = _plain("track", lambda: draw_track({t.name: t for t in study.trials}))
    yield from _picture("track", 1, "Track over ground, north up.", track)
    if sum(o.fit is not None for o in study.outcomes) > 1:
        caption = "Estimates of each method relative to the selected one, with 95 % intervals."
        yield from _picture("model", 2, caption, _methods(study))
    for i, (caption, figure) in enumerate(study.figures, start=1):
        yield from _picture("extra", i, caption, figure)


def _picture(kind: str, i: int, caption: str, figure: Figure | None) -> Iterator[Picture]:
    if figure is None:
        return
    name = f"{kind}-{i}"
    with pens(name):
        yield Picture(kind, caption, to_svg(figure, name, caption))


def _trace(trace: Trace, study: Study) -> Figure | None:
    run = next((t for t in study.trials if t.name == trace.run), None)
    with pens(trace.run):
        return draw_fit(trace, run, study.fit.model)


def _plain(name: str, draw: Callable[[], Figure | None]) -> Figure | None:
    with pens(name):
        return draw()


def _correlation(study: Study) -> Figure:
    from matplotlib.patches import Rectangle

    fit = study.fit
    names = [n for n, p in fit.parameters.items() if p.std > 0.0]
    places = [list(fit.parameters).index(n) for n in names]
    table = fit.correlation[np.ix_(places, places)]
    with pens("correlation"):
        figure, (axes,) = new_axes((max(1.2, 0.27 * len(names)),))
        for i, j in np.ndindex(table.shape):
            # As deep as the pair is correlated, on the page's own paper: a dark page has no white cells.
            deep, colour = abs(float(table[i, j])), AFTER if table[i, j] < 0.0 else BEFORE
            axes.add_patch(Rectangle((j - 0.5, i - 0.5), 1.0, 1.0, color=colour, alpha=DEEPEST * deep, lw=0))
            told = f"{table[i, j]:.2f}".replace("0.", ".")
            axes.text(j, i, told, ha="center", va="center", fontsize=6.5, color=INK)
        axes.set_xlim(-0.5, len(names) - 0.5)
        axes.set_ylim(len(names) - 0.5, -0.5)
        axes.set_xticks(range(len(names)), names, rotation=60, ha="right", fontsize=7)
        axes.set_yticks(range(len(names)), names, fontsize=7)
        axes.grid(False)
    return figure


def _methods(study: Study) -> Figure:
    names = [n for n, p in study.fit.parameters.items() if p.status == "fitted" and p.value != 0.0][:10]
    fits = [o.fit for o in study.outcomes if o.fit is not None][: len(_COLOURS)]
    with pens("methods"):
        figure, (axes,) = new_axes((0.34 * len(names) + 0.6,))
        for k, fit in enumerate(fits):
            for i, name in enumerate(names):
                found = fit.parameters.get(name)
                if found is None or found.status == "absent":
                    continue
                truth = study.fit.parameters[name].value
                reach = abs(1.96 * found.std / truth) if np.isfinite(found.std) else 0.0
                y = i + 0.7 * (k / max(len(fits) - 1, 1) - 0.5)
                label = fit.method if i == 0 else None
                axes.errorbar(found.value / truth, y, xerr=reach, fmt="o", ms=3, lw=1, color=_COLOURS[k], label=label)
        axes.set_yticks(range(len(names)), names)
        axes.set_xlim(0.0, 2.0)
        axes.invert_yaxis()
        axes.set_xlabel("estimate / selected")
        legend(axes)
    return figure
