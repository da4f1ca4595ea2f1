"""The transport of docs/developing.md, built as described: one file outside the package and one line."""

from __future__ import annotations

import re
import sys
import tomllib
from pathlib import Path

import pytest

from gcs_autotune.cli import main
from gcs_autotune.errors import UnknownName, UsageError
from gcs_autotune.link import open_link
from gcs_autotune.mavlink import load_params

GUIDE = (Path(__file__).parents[2] / "docs" / "developing.md").read_text(encoding="utf-8")
GROUP = "gcs_autotune.transports"


def guide_code(language: str) -> str:
    """Return the code of that *language* in the guide's section on transports."""
    section = GUIDE.split("## A transport of your own")[1].split("\n## ")[0]
    (code,) = re.findall(rf"```{language}\n(.*?)```", section, re.DOTALL)
    return str(code)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder on Python's path, as an installed package leaves it: the module, and what its line in pyproject made."""
    (tmp_path / "boathouse.py").write_text(guide_code("python"))
    lines = tomllib.loads(guide_code("toml"))["project"]["entry-points"][GROUP]
    described = tmp_path / "boathouse-1.0.dist-info"
    described.mkdir()
    points = "".join(f"{name} = {where}\n" for name, where in lines.items())
    (described / "entry_points.txt").write_text(f"[{GROUP}]\n{points}broken = boathouse:nothing\n")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "boathouse", raising=False)
    return tmp_path


def test_a_transport_from_outside_is_used_from_the_command_line(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    saved = folder / "charlie.param"
    assert main(["params", "save", "--connect", "boathouse:charlie", str(saved)]) == 0
    assert "link: boathouse:charlie" in capsys.readouterr().err
    assert load_params(saved)["SERVO1_FUNCTION"] == 26.0


def test_transports_of_other_packages_are_listed_with_our_own(folder: Path) -> None:
    with pytest.raises(UnknownName, match=r"Did you mean boathouse\?.*Known: udpin, .*sitl, boathouse"):
        open_link("boathuose:charlie")


def test_an_entry_point_that_cannot_be_loaded_is_reported(folder: Path) -> None:
    with pytest.raises(UsageError, match=r"'broken' \(boathouse:nothing\) cannot be loaded"):
        open_link("broken:charlie")
