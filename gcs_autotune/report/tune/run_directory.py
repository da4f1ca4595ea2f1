"""Write the run directory: JSON for programs, ``report.html`` for users. Each file is written atomically."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from gcs_autotune.documents import MODEL
from gcs_autotune.identify import model_document
from gcs_autotune.plain_json import json_text
from gcs_autotune.report.toolkit.data import to_json
from gcs_autotune.report.toolkit.document import Document, files_section
from gcs_autotune.report.toolkit.page import to_html
from gcs_autotune.report.tune.document import tune_document
from gcs_autotune.report.tune.story import TuneStory
from gcs_autotune.untrusted_text import visible
from gcs_autotune_files import Refused, parse

__all__ = ["PAGE", "SUMMARY", "save_page", "write_story"]


PAGE, SUMMARY, JOURNAL = "report.html", "summary.json", "journal.jsonl"


def write_story(story: TuneStory, directory: Path) -> Path:
    """Write the record of a tune into *directory* and return the path of ``report.html``.

    ``summary.json`` is always written; ``model.json``, ``fit.json``, ``gains.json``, ``parameters_before.json`` and
    ``parameters_after.json`` as far as the tune was completed. The page comes last, so that the numbers are on disk
    even if plotting fails.

    Raises
    ------
    OSError
        The directory cannot be written.
    """
    directory.mkdir(parents=True, exist_ok=True)
    for name, data in _parts(story).items():
        _write(directory / name, json_text(data))
    if not story.directory:
        story = replace(story, directory=str(directory))
    if not story.files:
        story = replace(story, files=_list_files(directory))
    document = tune_document(story)
    _write(directory / SUMMARY, json_text(to_json(document)))
    return _write(directory / PAGE, to_html(document))


def save_page(directory: Path, document: Document, name: str = PAGE) -> Path:
    """Write *document* as the page *name* of a run: with the vehicle in its title and links to the run's files.

    Raises
    ------
    OSError
        The directory cannot be written.
    """
    vehicle = _vehicle_of(directory)
    title = document.title if not vehicle or vehicle in document.title else f"{document.title} · {vehicle}"
    files = files_section(
        str(directory) if vehicle else "", _list_files(directory, {name, SUMMARY} if vehicle else {name})
    )
    return _write(directory / name, to_html(replace(document, title=title, sections=(*document.sections, *files))))


def _vehicle_of(directory: Path) -> str:
    """Return the firmware of the vehicle of a run, from its journal; empty without one."""
    try:
        with (directory / JOURNAL).open("rb") as lines:
            vehicle = parse(lines.readline()).get("vehicle")
    except (OSError, Refused, AttributeError):
        return ""
    return visible(str(vehicle.get("firmware") or "")) if isinstance(vehicle, dict) else ""


def _parts(story: TuneStory) -> Mapping[str, Any]:
    parts: dict[str, Any] = {}
    if story.fit is not None:
        parts[MODEL] = model_document(story.fit)
        parts["fit.json"] = story.fit.to_dict()
    if story.second_fit is not None:
        parts[f"model-{story.second_fit.dof}.json"] = model_document(story.second_fit)
    if story.given is not None:
        parts[MODEL] = story.given
    if story.proposal is not None:
        parts["gains.json"] = story.proposal.to_dict()
    if story.parameters_before:
        parts["parameters_before.json"] = dict(story.parameters_before)
    if story.parameters_after:
        parts["parameters_after.json"] = dict(story.parameters_after)
    return parts


def _list_files(directory: Path, written: Iterable[str] = (SUMMARY, PAGE)) -> tuple[str, ...]:
    """Return the files of a run with those that are still to be *written*."""
    present = {p.relative_to(directory).as_posix() for p in directory.rglob("*") if p.is_file() and p.suffix != ".part"}
    return tuple(sorted(present | set(written)))


def _write(path: Path, text: str) -> Path:
    """Write a temporary file and rename it, so that no reader sees a partial file."""
    draft = path.with_name(path.name + ".part")
    with draft.open("w", encoding="utf-8", newline="\n") as stream:
        stream.write(text)
        stream.flush()
        os.fsync(stream.fileno())
    draft.replace(path)
    return path
