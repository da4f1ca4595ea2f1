"""Write the run directory: JSON for programs, ``report.html`` for people; each file atomically."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from gcs_autotune.design import StepMetrics
from gcs_autotune.identify import model_document, whole_model
from gcs_autotune.plain_json import json_text
from gcs_autotune.report.tune.page import render_report
from gcs_autotune.report.tune.story import TuneStory

__all__ = ["SCHEMA", "summarise", "write_story"]


SCHEMA = 1


def write_story(story: TuneStory, directory: Path) -> Path:
    """Write the record of a tune into *directory* and return the path of ``report.html``.

    ``summary.json`` always; ``model.json``, ``fit.json``, ``gains.json``, ``parameters_before.json`` and
    ``parameters_after.json`` if the tune got that far. The page comes last, so that the numbers are on
    disk even if plotting fails.

    Raises
    ------
    OSError
        The directory cannot be written.
    """
    directory.mkdir(parents=True, exist_ok=True)
    for name, data in _documents(story).items():
        _write(directory / name, json_text(data))
    if not story.files:
        story = replace(story, files=_list_files(directory))
    if not story.directory:
        story = replace(story, directory=str(directory))
    return _write(directory / "report.html", render_report(story))


def _documents(story: TuneStory) -> Mapping[str, Any]:
    documents: dict[str, Any] = {}
    if story.fit is not None:
        documents["model.json"] = model_document(story.fit)
        documents["fit.json"] = story.fit.to_dict()
    if story.given is not None:
        documents["model.json"] = story.given
    if story.proposal is not None:
        documents["gains.json"] = story.proposal.to_dict()
    if story.parameters_before:
        documents["parameters_before.json"] = dict(story.parameters_before)
    if story.parameters_after:
        documents["parameters_after.json"] = dict(story.parameters_after)
    documents["summary.json"] = summarise(story)
    return documents


def summarise(story: TuneStory) -> dict[str, Any]:
    """Return a short summary for programs that read many runs."""
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
        "gains": {c.parameter: [c.old, c.new] for c in story.changes} if story.changes or proposal else None,
        "stable": None
        if proposal is None
        else {"model": proposal.margins.stable, "worst": proposal.worst_margins.stable},
        "model": story.given if fit is None else whole_model(fit).to_dict(),
        "std": None if fit is None else {name: p.std for name, p in fit.parameters.items()},
        "doubts": [*story.doubts, *(d.slug for d in (fit.doubts if fit else ()))],
        "differences": {name: list(pair) for name, pair in story.differences.items()},
    }


def _metrics(metrics: StepMetrics | None) -> dict[str, float] | None:
    return None if metrics is None else {name: getattr(metrics, name) for name in StepMetrics.__slots__}


def _list_files(directory: Path) -> tuple[str, ...]:
    found = {p.relative_to(directory).as_posix() for p in directory.rglob("*") if p.is_file() and p.suffix != ".part"}
    return tuple(sorted(found | {"report.html"}))


def _write(path: Path, text: str) -> Path:
    """Write a temporary file and rename it, so that no reader sees a partial file."""
    draft = path.with_name(path.name + ".part")
    with draft.open("w", encoding="utf-8", newline="\n") as stream:
        stream.write(text)
        stream.flush()
        os.fsync(stream.fileno())
    draft.replace(path)
    return path
