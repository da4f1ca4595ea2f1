"""The figure of the packages matches the imports, and the page lists every package and step."""

from __future__ import annotations

import ast
import importlib
import re
import sys
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PAGE = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")

sys.path.insert(0, str(ROOT / "docs"))
import draw_architecture  # noqa: E402


@pytest.mark.slow
def test_the_figure_is_current():
    drawn = draw_architecture.PICTURE.read_text(encoding="utf-8")
    assert drawn == draw_architecture.picture(), "run: python3 docs/draw_architecture.py"


def test_every_package_is_listed():
    reported = set(re.findall(r"`(\w+)`", PAGE[PAGE.index("| package |") : PAGE.index("## From")]))
    rooms = {p.name for p in (ROOT / "gcs_autotune").iterdir() if (p / "__init__.py").exists()}
    assert rooms - reported == set()


@pytest.mark.parametrize("name", re.findall(r"`([\w.]+\.\w+)`", PAGE[PAGE.index("## From") :]))
def test_each_step_of_the_walks_exists(name):
    module, _, rest = name.rpartition(".")
    try:
        found = importlib.import_module(f"gcs_autotune.{module}")
    except ModuleNotFoundError:  # a method: class and module before it
        module, _, kind = module.rpartition(".")
        found = getattr(importlib.import_module(f"gcs_autotune.{module}"), kind)
    assert hasattr(found, rest)


def test_an_arrow_is_left_out_only_if_a_longer_path_implies_it():
    graph = {"a": {"b", "c", "d"}, "b": {"c"}, "c": set(), "d": set()}
    assert draw_architecture.needed(graph) == [("a", "b"), ("a", "d"), ("b", "c")]


def circle_in(imports):
    """Return the modules of one import circle, none where there is none; *imports*: module -> modules it imports."""
    try:
        TopologicalSorter(imports).prepare()
    except CycleError as error:
        return error.args[1]
    return []


def imports_of(files):
    """Return module -> modules it imports, wherever in it; *files*: module -> path."""
    found = {}
    for module, path in files.items():
        nodes = [n for n in ast.walk(ast.parse(path.read_text(encoding="utf-8"))) if isinstance(n, ast.ImportFrom)]
        places = {
            f"{n.module}.{a.name}" if f"{n.module}.{a.name}" in files else n.module for n in nodes for a in n.names
        }
        found[module] = {place for place in places if place in files and place != module}
    return found


def test_no_modules_import_each_other_in_a_circle():
    paths = [p for package in ("gcs_autotune", "gcs_autotune_files", "sitl") for p in (ROOT / package).rglob("*.py")]
    files = {".".join(p.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__"): p for p in paths}
    assert sum(map(len, imports_of(files).values())) > 1000
    assert circle_in(imports_of(files)) == []


def test_an_import_circle_is_detected():
    assert set(circle_in({"a": {"b"}, "b": {"c"}, "c": {"a"}})) == {"a", "b", "c"}
    assert circle_in({"a": {"b", "c"}, "b": {"c"}, "c": set()}) == []
