"""The page of measured data: generated from the saved answers, a block for every case."""

from __future__ import annotations

from pathlib import Path

import pytest
from msgspec.structs import replace

from benchmarks.real_diagnosis import answers
from benchmarks.real_diagnosis.answers import BLOCK, PAGE, Answer, Finding, answer_of, keep, load, page
from benchmarks.real_diagnosis.cases import CASES
from gcs_autotune.api import diagnose, example_run


def test_the_page_is_generated_from_the_answers() -> None:
    text = PAGE.read_text(encoding="utf-8")
    assert text == page(), "run: python3 -m benchmarks.real_diagnosis --page"


def test_every_case_has_a_block_and_an_answer() -> None:
    blocks = [found["name"] for found in BLOCK.finditer(PAGE.read_text(encoding="utf-8"))]
    assert sorted(blocks) == sorted(CASES)
    assert set(load()) == set(CASES)


def test_an_answer_is_saved_with_the_others_and_shown(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    name = "rover-yaw"
    monkeypatch.setattr(answers, "FILE", tmp_path / "answers.json")
    monkeypatch.setattr(answers, "PAGE", tmp_path / "page.md")
    (tmp_path / "page.md").write_text(
        f"words\n<!-- case {name}: made by python3 -m benchmarks.real_diagnosis -->\nold\n<!-- end -->\nmore words\n"
    )
    keep({"sub-yaw": Answer(refused="too short")})
    assert "Not recorded yet" in (tmp_path / "page.md").read_text()
    result = answer_of(diagnose(example_run(), dof="yaw", effects=["quadratic-drag"]))
    found = Finding("`dead-zone` (N): width 0.3", "+12 in log-likelihood", "psi 5 s ahead: 35 to 8 deg")
    keep({name: replace(result, causes=(found,))})
    shown = (tmp_path / "page.md").read_text()
    assert shown.startswith("words\n") and shown.endswith("more words\n") and "old" not in shown
    assert f"**{result.lead}**" in shown and "| cause | `dead-zone` (N): width 0.3 |" in shown
    assert set(load()) == {"sub-yaw", name} and load()["sub-yaw"].refused == "too short"
