"""The README, the pages it links to, and the usual files of a public project."""

from __future__ import annotations

import json
import re
import sys
import tomllib
from pathlib import Path

import pytest

from gcs_autotune.cli import COMMANDS

from .conftest import module_of_the_docs

ROOT = Path(__file__).parents[1]
FOLDERS = ("*.md", "docs/**/*.md", "benchmarks/**/*.md")
PAGES = sorted(p.relative_to(ROOT).as_posix() for folder in FOLDERS for p in ROOT.glob(folder))
LINK = re.compile(r"\]\((?!https?:|#)([^)#\s]+)")
MADE = {
    ROOT / "docs" / "reference" / f"{name}.md"
    for name in re.findall(r'^    "(\w+)": \1,$', (ROOT / "docs" / "site_reference.py").read_text(), re.MULTILINE)
}
"""Pages that the site makes from the code; tests/test_site.py follows the links of the whole site."""
SHELL = re.compile(r"^```sh\n(.*?)^```", re.MULTILINE | re.DOTALL)


def test_the_readme_is_short_with_two_figures_and_short_paragraphs():
    text = (ROOT / "README.md").read_text()
    assert len(text.splitlines()) <= 80
    assert len(re.findall(r"!\[", text)) == 2
    prose = re.sub(r"^```.*?^```", "", text, flags=re.MULTILINE | re.DOTALL)
    paragraphs = [p for p in prose.split("\n\n") if p.strip() and not p.lstrip().startswith(("|", "1.", "*"))]
    assert [p for p in paragraphs if len(p.strip().splitlines()) > 5 or len(p) > 700] == []
    assert max(map(len, text.splitlines())) <= 180


def test_the_screenshot_of_the_page_is_current():
    draw_page = module_of_the_docs("draw_page")
    assert draw_page.drawn_of() == draw_page.fingerprint(), "run: python3 docs/draw_page.py docs/pictures/page.png"


def test_a_drawing_that_fails_ends_its_programs():
    draw_page = module_of_the_docs("draw_page")
    with (
        pytest.raises(ValueError, match="no page"),
        draw_page.running([sys.executable, "-c", "import signal; signal.pause()"]) as program,
    ):
        raise ValueError("no page")
    assert program.returncode is not None


def test_the_figure_of_a_tune_records_its_run_and_another_run_is_detected(tmp_path: Path):
    draw_picture = module_of_the_docs("draw_picture")
    drawn = draw_picture.drawn_from(ROOT / "docs" / "pictures" / "tune.png")
    assert "ATC_STR_RAT_FF" in drawn
    change = [{"parameter": name, "old": 0.0, "new": new} for name, new in drawn.items()]
    (tmp_path / "gains.json").write_text(json.dumps({"changes": change}))
    assert draw_picture.differs(tmp_path, ROOT / "docs" / "pictures" / "tune.png") == []
    change[0]["new"] *= 1.2
    (tmp_path / "gains.json").write_text(json.dumps({"changes": change}))
    assert draw_picture.differs(tmp_path, ROOT / "docs" / "pictures" / "tune.png") == [change[0]["parameter"]]


def test_the_success_maps_show_the_recorded_figures_and_the_pages_cite_them():
    drawn = module_of_the_docs("draw_success_maps").drawn_from(ROOT / "docs" / "pictures" / "thesis-7-5.svg")
    recorded = json.loads((ROOT / "benchmarks" / "results" / "thesis_7_5.json").read_text())["figures"]
    shared = {f["name"]: [f["value"], f["of"]] for f in recorded if f["name"] in drawn}
    assert {"day 1: valid experiments", "day 2: pairs decided for the linear model, no margin"} <= set(shared)
    assert shared == {name: drawn[name] for name in shared}
    pages = [(ROOT / page).read_text() for page in ("docs/study.md", "benchmarks/notes/thesis-7-5.md")]
    counts = [f"{right} of {cases}" for right, cases in drawn.values()]
    assert [(words, page[:40]) for words in counts for page in pages if words not in page] == []


def test_every_page_is_checked():
    assert {"README.md", "CONTRIBUTING.md", "docs/tune.md", "docs/diagnose.md"} <= set(PAGES)


@pytest.mark.parametrize("page", PAGES)
def test_every_link_to_a_local_file_is_valid(page: str):
    links = [(link, (ROOT / page).parent / link) for link in LINK.findall((ROOT / page).read_text())]
    assert [link for link, file in links if not file.exists() and file.resolve() not in MADE] == []


@pytest.mark.parametrize("page", PAGES)
def test_pages_name_commands_and_options_that_exist(page: str, capsys: pytest.CaptureFixture[str]):
    blocks = "\n".join(SHELL.findall((ROOT / page).read_text()))
    called = re.findall(r"gcs-autotune ([a-z]+)\b([^\n#&|]*)", blocks)
    wrong = []
    for verb, rest in called:
        if verb not in COMMANDS:
            wrong.append(verb)
        elif verb not in ("sitl", "logs", "params", "study", "calibrate"):  # these hand over to verbs of their own
            shown = _help(verb, capsys)
            wrong += [f"{verb} {o}" for o in re.findall(r"(?<!\S)--[a-z][a-z-]*", rest) if o not in shown]
    assert wrong == []


def _help(verb: str, capsys: pytest.CaptureFixture[str]) -> str:
    from gcs_autotune.cli import main

    with pytest.raises(SystemExit):
        main([verb, "--help-all" if COMMANDS[verb].load().everyday else "--help"])
    return capsys.readouterr().out


def test_version_and_licence_are_the_same_everywhere():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    citation = (ROOT / "CITATION.cff").read_text()
    assert f"version: {project['version']}\n" in citation
    assert f"license: {project['license']}\n" in citation
    assert "BSD 3-Clause License" in (ROOT / "LICENSE").read_text()
    assert f"## {project['version']}" in (ROOT / "CHANGELOG.md").read_text()
