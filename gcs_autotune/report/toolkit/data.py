"""Convert a document to data, for the output of ``--json`` and for ``summary.json``."""

from __future__ import annotations

from typing import Any

from gcs_autotune.report.toolkit.document import Document, Figure, Note, Part, Section, Table, is_empty

__all__ = ["to_json"]


def to_json(document: Document) -> dict[str, Any]:
    """Return the facts of *document* and of its sections as plain data, for
    :func:`gcs_autotune.plain_json.json_text`.
    """
    data = dict(document.facts)
    for section in document.sections:
        if section.facts is not None:
            data.update(section.facts)
        elif not is_empty(section):
            data[section.slug.replace("-", "_")] = _section(section)
    return data


def _section(section: Section) -> dict[str, Any]:
    return {"title": section.title, "parts": [_part(part) for part in section.parts if not is_empty(part)]}


def _part(part: Part) -> dict[str, Any]:
    if isinstance(part, Section):
        return _section(part)
    if isinstance(part, Table):
        return {"heads": list(part.heads), "rows": [list(row) for row in part.rows]}
    if isinstance(part, Figure):
        return {"figure": part.caption}
    assert isinstance(part, Note)
    return {"label": part.label, "text": part.text} if part.label else {"text": part.text}
