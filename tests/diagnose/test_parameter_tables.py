"""Tables of identified parameters: which level, sign or row contradicts the others, and what the scatter hides."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks.real_diagnosis.published import tables_of
from gcs_autotune.cli import main
from gcs_autotune.diagnose import ParameterTable, TableFinding, diagnose_table
from gcs_autotune.errors import NotInformative

LEVELS = np.repeat([1.0, 2.0, 3.0, 4.0], 6)


def table(seed: int = 0, scatter: float = 0.03, level: np.ndarray[Any, Any] = LEVELS, **spoiled: Any) -> ParameterTable:
    rng = np.random.default_rng(seed)
    inertia, drag = (np.exp(rng.normal(0.0, scatter, len(level))) for _ in range(2))
    return ParameterTable("made up", level, inertia * spoiled.get("inertia", 1.0), drag * spoiled.get("drag", 1.0))


def finding(table: ParameterTable, question: str, quantity: str, where: str = "") -> TableFinding:
    return next(
        f for f in diagnose_table(table) if (f.question, f.quantity) == (question, quantity) and where in f.where
    )


def test_a_consistent_table_has_no_finding() -> None:
    answers = [f.answer for seed in range(40) for f in diagnose_table(table(seed))]
    assert answers.count("yes") <= 0.01 * len(answers)


def test_missing_thrust_at_one_level_raises_inertia_and_drag() -> None:
    more = np.where(LEVELS == 3.0, 1.3, 1.0)
    found = [finding(table(seed, inertia=more, drag=more), "level", "inertia", "= 3") for seed in range(20)]
    sure = [f for f in found if f.answer == "yes"]
    assert len(sure) >= 15
    assert np.mean([f.share for f in found]) == pytest.approx(0.3, abs=0.02)
    assert sum("of the stated thrust is missing" in f.reading for f in sure) >= 0.9 * len(sure)


def test_another_load_at_one_level_raises_only_the_inertia() -> None:
    loaded = np.where(LEVELS == 4.0, 1.25, 1.0)
    found = [finding(table(seed, inertia=loaded), "level", "inertia", "= 4") for seed in range(20)]
    sure = [f for f in found if f.answer == "yes"]
    assert len(sure) >= 15
    assert all(f.reading.startswith("only inertia deviates") for f in sure)


def test_a_dead_zone_shows_at_the_smallest_input() -> None:
    lost = LEVELS / (LEVELS - 0.25)
    found = finding(table(inertia=lost, drag=lost), "smallest-input", "drag")
    assert found.answer in ("yes", "cannot tell")
    assert found.share > 0.15
    trend = finding(table(inertia=lost, drag=lost, scatter=0.005), "trend", "drag")
    assert trend.share < 0.0


def test_asymmetric_thrust_shows_in_the_comparison_of_signs() -> None:
    level = np.concatenate([-LEVELS, LEVELS])
    less = np.where(level < 0.0, 1.2, 1.0)
    found = finding(table(level=level, inertia=less, drag=less), "sign", "drag")
    assert found.answer == "yes"
    assert found.share == pytest.approx(1.0 / 1.2 - 1.0, abs=0.03)
    assert "asymmetric thrust" in found.reading
    assert finding(table(level=level), "sign", "drag").answer == "no"


def test_one_wrong_row_is_reported() -> None:
    wrong = np.ones(len(LEVELS))
    wrong[8] = 1.5
    rows = [f for f in diagnose_table(table(inertia=wrong)) if f.question == "row"]
    assert [f.where.split(" (")[0] for f in rows] == ["row 9"]


def test_too_few_rows_and_invalid_values_are_rejected() -> None:
    with pytest.raises(NotInformative, match="2 rows"):
        diagnose_table(ParameterTable("short", np.ones(2), np.ones(2), np.ones(2)))
    with pytest.raises(NotInformative, match="positive"):
        diagnose_table(ParameterTable("odd", np.ones(5), -np.ones(5), np.ones(5)))


@pytest.fixture(scope="module")
def published() -> dict[str, ParameterTable]:
    path = Path(__file__).parents[2] / ".." / "shared" / "data" / "published_tables.json"
    if not path.exists():
        pytest.skip("published_tables.json is not beside the repository (../shared/data)")
    return {t.name: t for t in tables_of(json.loads(path.read_text(encoding="utf-8")))}


def test_automarine_at_the_largest_input_has_a_larger_inertia_and_the_same_drag(
    published: dict[str, ParameterTable],
) -> None:
    automarine = published["AutoMarine, IS-O"]
    found = finding(automarine, "level", "inertia", "6.46")
    assert found.answer == "yes"
    assert 0.15 < found.share < 0.28
    assert finding(automarine, "level", "drag", "6.46").answer != "yes"
    assert found.reading.startswith("only inertia deviates")


def test_automarine_steps_cannot_distinguish_the_signs(published: dict[str, ParameterTable]) -> None:
    for quantity in ("inertia", "drag"):
        found = finding(published["AutoMarine, steps"], "sign", quantity)
        assert found.answer == "cannot tell"
        assert found.ci95[0] < 0.0 < found.ci95[1]


def test_the_smallest_inputs_cannot_be_distinguished_from_scatter(published: dict[str, ParameterTable]) -> None:
    assert len(published) >= 3
    for one in published.values():
        assert finding(one, "smallest-input", "drag").answer == "cannot tell"


def test_automarine_steps_show_quadratic_drag_and_videoray_a_mixture(published: dict[str, ParameterTable]) -> None:
    steps = finding(published["AutoMarine, steps"], "drag-order", "linear drag")
    assert steps.share == pytest.approx(2.0, abs=0.1)
    rov = finding(published["VideoRay, IS-O"], "drag-order", "linear drag")
    assert 1.0 < rov.ci95[0] < rov.ci95[1] < 2.0


def test_the_command_reports_the_row_that_contradicts_the_others(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    made = table()
    path = tmp_path / "steps.csv"
    rows = [f"{a},{b},{c}" for a, b, c in zip(made.level, made.inertia, made.drag, strict=True)]
    rows[8] = f"{made.level[8]},{1.6 * made.inertia[8]},{made.drag[8]}"
    path.write_text("\n".join(["level[N],inertia[kg],drag[N s^2/m^2]", *rows]) + "\n")
    assert main(["diagnose", str(path), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)["findings"]
    assert [f["where"].split(" (")[0] for f in found if f["question"] == "row"] == ["row 9"]
    assert main(["diagnose", str(path), "--out", str(tmp_path / "out")]) == 2
    assert "its only options are --json" in capsys.readouterr().err.lower()
    assert main(["diagnose", str(path)]) == 0
    assert "Repeat that experiment" in " ".join(capsys.readouterr().out.split())
