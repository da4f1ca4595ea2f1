"""The record of a tune as data for ``summary.json``."""

from __future__ import annotations

import math
from typing import Any

from gcs_autotune.design import Linearity, PositionMetrics, StepMetrics, TrackMetrics
from gcs_autotune.report.tune.story import TuneStory

__all__ = ["SCHEMA", "summarise"]


SCHEMA = 1


def summarise(story: TuneStory) -> dict[str, Any]:
    """Return a short summary of a tune as plain data, for programs that read the results of many runs."""
    proposal, fit = story.proposal, story.fit
    return {
        "schema": SCHEMA,
        "title": story.title,
        "when": story.when,
        "axis": story.axis,
        "vehicle": dict(story.vehicle),
        "ending": story.ending,
        "reason": story.reason,
        "kept": story.kept,
        "verdict_reasons": list(story.verdict_reasons),
        "metrics": {"before": _metrics(story.metrics_before), "after": _metrics(story.metrics_after)},
        "turn_rates": None
        if story.beside is None
        else dict(zip(("before", "after"), map(_metrics, story.beside), strict=True)),
        "thrust": None
        if story.thrust_before is None
        else {"before": story.thrust_before.to_dict(), "after": _told(story.thrust_after)},
        "track": None
        if story.track_before is None
        else {"before": story.track_before.to_dict(), "after": _told(story.track_after)},
        "position": None
        if story.position_before is None
        else {"before": _position(story.position_before), "after": _position(story.position_after)},
        "gains": {c.parameter: [c.old, c.new] for c in story.changes} if story.changes or proposal else None,
        "stable": None
        if proposal is None
        else {"model": proposal.margins.stable, "worst": proposal.worst_margins.stable},
        "model": story.given if fit is None else fit.whole_model.to_dict(),
        "std": None if fit is None else {name: p.std for name, p in fit.parameters.items()},
        "doubts": [*story.doubts, *(d.slug for d in (fit.doubts if fit else ()))],
        "differences": {name: list(pair) for name, pair in story.differences.items()},
    }


def _told(metrics: TrackMetrics | Linearity | None) -> dict[str, object] | None:
    return None if metrics is None else metrics.to_dict()


def _position(metrics: PositionMetrics | None) -> dict[str, float | None] | None:
    """Return the figures, with None for those that were not measured."""
    if metrics is None:
        return None
    return {name: value if math.isfinite(value) else None for name, value in metrics.to_dict().items()}


def _metrics(metrics: StepMetrics | None) -> dict[str, float] | None:
    return None if metrics is None else {name: getattr(metrics, name) for name in StepMetrics.__slots__}
