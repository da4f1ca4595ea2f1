"""Benchmarks that are studies."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchmarks import embedded_accuracy
from benchmarks.embedded_accuracy import CASE, Result, Row, result_of
from benchmarks.studies import FOLDER
from gcs_autotune.study import check_plan, load_plan, open_study
from tests.study.toys import ran


@pytest.mark.parametrize("file", sorted(FOLDER.glob("*.toml")), ids=lambda file: file.stem)
def test_every_study_file_is_accepted(file: Path) -> None:
    plan = load_plan(file)
    check_plan(plan)
    assert plan.title


def test_a_row_of_the_embedded_accuracy_gives_its_result(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    row = Row(1.0, (1.1, 0.1), (1.2, 0.2), 0.05, 0.06, 0.04, 1.3)
    results = {
        "heading": Result({"alpha_r": row, "delta": row}, "linear", ("psi", "r"), 0.01),
        "depth": Result({"alpha_w": row}, "affine", ("z",), 0.02),
    }
    monkeypatch.setattr(embedded_accuracy, "one", lambda vehicle, axis, seed: results[axis])
    text = (FOLDER / "embedded_accuracy.toml").read_text().replace("repeats = 50", "repeats = 2")
    (tmp_path / "study.toml").write_text(text)
    ran(tmp_path / "study.toml", tmp_path / "out")
    rows = open_study(tmp_path / "out").to_dict("records")
    assert len(rows) == 12
    assert all(result_of(row) == results[row[CASE].split()[1]] for row in rows)
