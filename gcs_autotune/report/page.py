"""Templates filled in: every page this tool writes is made here."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined, select_autoescape

__all__ = ["render_page"]


def render_page(template: str, context: Mapping[str, Any]) -> str:
    """Return the page; the same context gives the same bytes."""
    environment = Environment(
        loader=PackageLoader("gcs_autotune.report", "templates"),
        autoescape=select_autoescape(["html"]),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["glued"] = _glued
    return environment.get_template(template).render(context) + "\n"


def _glued(text: str) -> str:
    """Keep a number and its unit on one line."""
    return re.sub(r"(?<=\d) (?=%|(?:s|m|dB|Hz)\b)", "\u00a0", text)
