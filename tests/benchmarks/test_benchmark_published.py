"""The table of published numbers: what is quick to compute reaches its goals, and a miss is seen."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from benchmarks.published.__main__ import TABLES, main
from benchmarks.published.section import Row, Section
from benchmarks.published.sections import SECTIONS

QUICK = (
    "videoray_iso_table_7_9",
    "automarine_iso_table_7_11",
    "automarine_step_table_7_10",
    "laser_calibration_table_3_1",
    "model_comparison_7_3_3",
    "model_comparison_7_4_3",
)


@pytest.fixture
def tables() -> Path:
    if not TABLES.is_file():
        pytest.skip("published_tables.json is not beside the repository (../shared/data)")
    return TABLES


def test_every_key_of_the_file_has_a_section(tables: Path) -> None:
    assert set(json.loads(tables.read_text(encoding="utf-8"))) <= set(SECTIONS)


@pytest.mark.parametrize("name", QUICK)
def test_results_from_printed_inputs_reach_their_goal(name: str, tables: Path) -> None:
    sections = list(SECTIONS[name](json.loads(tables.read_text(encoding="utf-8"))))
    assert sections
    for section in sections:
        assert section.rows
        assert section.met, f"{section.title}: {section.worst}"


def test_a_changed_number_is_reported_as_missed(
    tables: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    wrong = json.loads(tables.read_text(encoding="utf-8"))
    wrong["videoray_iso_table_7_9"]["rows"][3][5] *= 1.02
    file = tmp_path / "tables.json"
    file.write_text(json.dumps(wrong), encoding="utf-8")
    assert main(["--tables", str(file), "--only", "videoray_iso_table_7_9"]) == 1
    assert "MISSED" in capsys.readouterr().out
    assert main(["--tables", str(tables), "--only", "videoray_iso_table_7_9", "--brief"]) == 0


def test_a_missing_file_is_reported(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--tables", str(tmp_path / "none.json")]) == 2
    assert "--tables" in capsys.readouterr().err


def test_a_number_that_is_not_finite_never_meets_a_goal() -> None:
    assert not Section("", "", (Row("a", 1.0, float("nan")),)).met
    assert not Section("", "", (Row("a", 1.0, 1.0), Row("b", 1.0, float("inf"))), below=True).met
    assert Section("", "", (Row("a", 4.0, 3.0),), below=True).met
