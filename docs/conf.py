"""Sphinx builds the site from the pages beside this file: python3 -m sphinx -W -b html docs docs/_build

Reference pages are made from the code itself (``site_reference.py``); blocks ```` ```{run} ```` are executed, and so
are the cells of pages with ``file_format: mystnb``.
"""

from __future__ import annotations

import os
import re
import sys
from pathlib import Path

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE), str(HERE.parent)]
os.environ["MPLBACKEND"] = "Agg"
os.environ["PYTHONPATH"] = os.pathsep.join(filter(None, (str(HERE.parent), os.environ.get("PYTHONPATH"))))

import site_reference  # noqa: E402
import site_run  # noqa: E402
import site_vehicles  # noqa: E402

import gcs_autotune  # noqa: E402

project = "gcs_autotune"
author = copyright = "the gcs_autotune authors"
version = release = gcs_autotune.__version__
extensions = ["myst_nb", "sphinx_design", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
exclude_patterns = ["_build", "references.bib"]
html_theme = "furo"
html_title = f"gcs_autotune {release}"
html_static_path: list[str] = []
myst_enable_extensions = ["colon_fence", "deflist"]
myst_heading_anchors = 3
nb_execution_mode = "cache"
nb_execution_raise_on_error = True
nb_execution_timeout = 120
autodoc_member_order = "bysource"
autodoc_typehints = "none"
napoleon_google_docstring = False
SOURCE = "https://github.com/gcs-autotune/gcs-autotune/blob/main/"
_LINK = re.compile(r"\]\((?!https?:|#)[^)\s]+\)")


def lead_out(app: object, name: str, source: list[str]) -> None:
    """Let links to files of the repository that are no page of the site lead to the repository."""

    def away(match: re.Match[str]) -> str:
        target = (HERE / f"{name}.md").parent / match[0][2:-1].partition("#")[0]
        inside = target.resolve().is_relative_to(HERE.resolve()) and target.suffix in (".md", ".png", ".svg")
        if inside:
            return match[0]
        return f"]({SOURCE}{target.resolve().relative_to(HERE.parent.resolve()).as_posix()})"

    source[0] = _LINK.sub(away, source[0])


def setup(app: object) -> None:
    """Make the reference pages before anything is read."""
    site_reference.write(HERE / "reference")
    app.add_directive("run", site_run.Run)  # type: ignore[attr-defined]
    app.add_directive("terminal", site_run.Terminal)  # type: ignore[attr-defined]
    app.add_directive("vehicles", site_vehicles.Vehicles)  # type: ignore[attr-defined]
    app.connect("source-read", lead_out)  # type: ignore[attr-defined]
