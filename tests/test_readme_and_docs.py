"""What an outsider meets first: the README, the pages it leads to, the files every public project has."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import pytest

from gcs_autotune.cli import COMMANDS
from gcs_autotune.effects import EFFECTS

ROOT = Path(__file__).parents[1]
PAGES = sorted(p.relative_to(ROOT).as_posix() for p in (*ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md")))
LINK = re.compile(r"\]\((?!https?:|#)([^)#\s]+)")
MADE = {
    ROOT / "docs" / "reference" / f"{name}.md"
    for name in re.findall(r'^    "(\w+)": \1,$', (ROOT / "docs" / "site_reference.py").read_text(), re.MULTILINE)
}
"""Pages that the site makes from the code; tests/test_site.py follows the links of the whole site."""
SHELL = re.compile(r"^```sh\n(.*?)^```", re.MULTILINE | re.DOTALL)


def test_the_readme_is_one_page_with_one_picture():
    text = (ROOT / "README.md").read_text()
    assert len(text.splitlines()) <= 150
    assert len(re.findall(r"!\[", text)) == 1


def test_every_page_is_looked_at():
    assert {"README.md", "CONTRIBUTING.md", "docs/tune.md", "docs/diagnose.md"} <= set(PAGES)


@pytest.mark.parametrize("page", PAGES)
def test_every_link_to_a_file_of_ours_leads_to_one(page: str):
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
        elif verb not in ("sitl", "logs", "params"):  # these hand over to verbs of their own
            shown = _help(verb, capsys)
            wrong += [f"{verb} {o}" for o in re.findall(r"(?<!\S)--[a-z][a-z-]*", rest) if o not in shown]
    assert wrong == []


def _help(verb: str, capsys: pytest.CaptureFixture[str]) -> str:
    from gcs_autotune.cli import main

    with pytest.raises(SystemExit):
        main([verb, "--help"])
    return capsys.readouterr().out


def test_version_and_licence_are_told_alike_everywhere():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    citation = (ROOT / "CITATION.cff").read_text()
    assert f"version: {project['version']}\n" in citation
    assert f"license: {project['license']}\n" in citation
    assert "BSD 3-Clause License" in (ROOT / "LICENSE").read_text()
    assert f"## {project['version']}" in (ROOT / "CHANGELOG.md").read_text()


@pytest.mark.parametrize("page", ["README.md", "docs/diagnose.md"])
def test_pages_count_the_effects_that_there_are(page: str):
    counted = re.findall(r"(\d+) effects", (ROOT / page).read_text())
    assert counted
    assert set(counted) == {str(len(EFFECTS))}
