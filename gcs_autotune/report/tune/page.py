"""The page of a tune: one self-contained ``report.html`` that opens offline, on a phone and on paper."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from gcs_autotune.identify import AxisFit
from gcs_autotune.report.toolkit.axis_fit import (
    candidate_table,
    cycle_table,
    decision_sentence,
    estimate_table,
    model_sentences,
    model_table,
    model_words,
)
from gcs_autotune.report.toolkit.page import Picture, Table, render_page
from gcs_autotune.report.toolkit.wording import (
    doubt_sentence,
    format_change,
    format_moment,
    format_percent,
    format_quantity,
    format_share,
)
from gcs_autotune.report.tune.figures import draw_pictures
from gcs_autotune.report.tune.story import TuneStory
from gcs_autotune.report.tune.tables import (
    beside_table,
    changed_parameters,
    gains_table,
    margins_table,
    metrics_table,
    rates_table,
    vehicle_rows,
)
from gcs_autotune.report.tune.wording import (
    PROOF_SENTENCE,
    bound_sentence,
    headline,
    proof_command,
    safety,
    settling_cell,
    undo_command,
    undo_sentence,
)

__all__ = ["render_report"]


def render_report(story: TuneStory) -> str:
    """Return the whole page; the same story gives the same bytes."""
    return render_page("tune/page.html", _context(story))


def _context(story: TuneStory) -> dict[str, Any]:
    proposal, fit = story.proposal, story.fit
    return {
        "story": story,
        "headline": headline(story),
        "tiles": _tiles(story),
        "doubts": (*story.doubts, *(() if fit is None else (doubt_sentence(d) for d in fit.doubts))),
        "pictures": _by_kind(draw_pictures(story)),
        "metrics": _metrics(story),
        "beside": None if story.beside is None else beside_table(story),
        "gains": gains_table(story.changes) if story.changes or proposal is not None else None,
        "proof": proof_command(story) if story.awaits_proof and story.proving else "",
        "proof_sentence": PROOF_SENTENCE,
        "margins": None if proposal is None else margins_table(proposal),
        "safety": "" if proposal is None else safety(proposal),
        "bound": "" if proposal is None else bound_sentence(proposal.bound),
        "predicted": _predicted(story),
        "fit": None if fit is None else _fit(fit),
        "vehicle": vehicle_rows(story.vehicle),
        "simulated": bool(story.vehicle.get("simulated", False)),
        "rates": rates_table(story.rates),
        "events": tuple((_moment(t), text) for t, text in story.events),
        "parameters": changed_parameters(story),
        "changed": len(story.differences),
        "undo": undo_command(story),
        "undo_sentence": undo_sentence(story),
        "when": format_moment(story.when),
    }


def _fit(fit: AxisFit) -> Mapping[str, Any]:
    return {
        "structure": model_words(fit),
        "method": fit.method,
        "used": ", ".join(fit.used),
        "sentences": model_sentences(fit),
        "model": model_table(fit),
        "decision": "" if fit.decision is None else decision_sentence(fit),
        "candidates": candidate_table(fit),
        "cycles": cycle_table(fit),
        "estimates": estimate_table(fit),
    }


def _metrics(story: TuneStory) -> Table | None:
    if story.metrics_before is None and story.metrics_after is None:
        return None
    return metrics_table(story.metrics_before, story.metrics_after)


def _predicted(story: TuneStory) -> Table | None:
    if story.proposal is None:
        return None
    return metrics_table(story.proposal.before.metrics, story.proposal.after.metrics)


def _tiles(story: TuneStory) -> tuple[tuple[str, str, str], ...]:
    """Return the key figures: (number, label, remark)."""
    before, after, source = story.metrics_before, story.metrics_after, "measured"
    if story.proposal is not None and (before is None or after is None):
        before, after, source = story.proposal.before.metrics, story.proposal.after.metrics, "predicted"
    tiles = []
    if before is not None and after is not None:
        old, new = settling_cell(before), settling_cell(after)
        tiles = [
            (format_change(before.itae, after.itae).replace("-", "\u2212") or "?", "tracking error", source),
            (format_share(after.overshoot), "overshoot", f"{source}, was {format_share(before.overshoot)}"),
            (new, "settling time", f"{source}, was {old}"),
        ]
    if story.proposal is not None:
        worst = story.proposal.worst_margins
        margin = format_quantity(worst.phase, "rad", 2) if worst.stable else "unstable"
        tiles.append((margin, "phase margin", "worst case"))
    if story.fit is not None:
        tiles.append((format_percent(story.fit.fit_percent), "model fit", "free run"))
    return tuple(tiles)


def _by_kind(pictures: tuple[Picture, ...]) -> Mapping[str, tuple[Picture, ...]]:
    kinds = ("step", "relay", "cycle", "fit", "intervals", "thrust", "bode", "track")
    return {kind: tuple(p for p in pictures if p.kind == kind) for kind in kinds}


def _moment(t: float) -> str:
    return "" if t != t else f"{t:.1f} s"
