"""Benchmarks that are studies."""

from __future__ import annotations

import signal
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path

import pytest

from benchmarks import embedded_accuracy, thesis_7_5
from benchmarks.embedded_accuracy import CASE, Result, Row, result_of
from benchmarks.studies import FOLDER, in_main_thread
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


def relay_row(C: float, x_a: float, beta: float, **other: object) -> dict[str, object]:
    """A row of the study of Miskovic2010, 7.5: a craft with linear drag *beta*, seen exactly by IS-O."""
    cycle = {"C": C, "x_a": x_a, "x_a_star": x_a, "X_m": 2.0 * x_a, "x_0": 0.0, "omega": 0.3, "T_H": 10.0, "T_L": 10.0}
    values = {"argument.n2": 16, "argument.C": C, "argument.x_a": x_a, "valid": True, "ending": "completed"}
    readings = {f"cycle.{name}": value for name, value in {**cycle, "periods": 5, "scatter": 0.0}.items()}
    iso = {"iso.alpha": 10.0, "iso.beta": beta, "iso.beta_quadratic": beta / C, "iso.delta": 0.0}
    fits = {f"{s}.{n}": 10.0 if n == "alpha" else 3.0 for s in thesis_7_5.STRUCTURES for n in ("alpha", "beta", "fit")}
    return {**values, **readings, **iso, **fits, **other}


def test_pairs_of_relays_with_one_output_decide_nothing_and_equal_drags_are_linear() -> None:
    rows = [relay_row(C, x_a, 3.0) for C in (10.0, 20.0) for x_a in (5.0, 10.0)]
    assert thesis_7_5.decisions(rows, "none") == (4, 0, 0)
    quadratic = [relay_row(C, x_a, C) for C in (10.0, 20.0) for x_a in (5.0, 10.0)]
    assert thesis_7_5.decisions(quadratic, "none") == (0, 4, 0)


def test_exact_limit_cycles_of_the_published_drag_decide_most_pairs_of_one_speed() -> None:
    rows = thesis_7_5.exact_rows(load_plan(FOLDER / "thesis_7_5.toml"))
    assert thesis_7_5.decisions(rows, "none") == (1121, 229, 0)
    assert thesis_7_5.decisions(rows, "none", one_speed=True) == (255, 15, 0)
    assert thesis_7_5.decisions(rows, "none", over_inertia=True) == (1260, 90, 0)
    first = next(row for row in rows if (row["argument.n2"], row["argument.C"], row["argument.x_a"]) == (25, 10, 5))
    assert first["iso.beta"] == pytest.approx(1.008 * 2.635, rel=1e-3)


def test_rudder_effectiveness_does_not_change_the_decision_by_drag_over_inertia() -> None:
    quadratic = [
        relay_row(C, 5.0, gain * C, **{"argument.n2": n2, "iso.alpha": gain * 10.0, "iso.beta_quadratic": gain})
        for n2, gain, C in ((16, 1.5, 10.0), (25, 1.0, 15.0))
    ]
    assert thesis_7_5.decisions(quadratic, "none") == (1, 0, 0)  # wrong: 15 and 15 are equal, 1.5 and 1 are not
    assert thesis_7_5.decisions(quadratic, "none", over_inertia=True) == (0, 1, 0)


def test_the_drag_of_a_relay_is_compared_with_least_squares_at_its_speed() -> None:
    rows = [relay_row(10.0, 5.0, 3.3), relay_row(20.0, 5.0, 3.0), relay_row(25.0, 5.0, 9.0, valid=False)]
    (drag, constant), (none, same) = thesis_7_5.compared(rows)
    assert drag == pytest.approx(10.0)
    assert constant == pytest.approx(10.0 / 3.0 - 10.0 / 3.3)
    assert (none, same) == (0.0, 0.0)


def test_valid_relay_experiments_of_a_day_are_counted(capsys: pytest.CaptureFixture[str]) -> None:
    lost = relay_row(10.0, 10.0, 3.0, valid=False, ending="no oscillation")
    figures = thesis_7_5.figures_of("day 2", [relay_row(10.0, 5.0, 3.0), relay_row(20.0, 5.0, 3.9), lost], 0.8)
    printed = capsys.readouterr().out
    assert "not valid: n2 = 16 V^2, C = 10 deg, x_a = 10 deg: no oscillation" in printed
    assert "apart: n2 = 16 V^2, C = 20 deg, x_a = 5 deg: drag by 30.0 %" in printed
    shown = {figure.name: figure.value for figure in figures}
    assert shown["day 2: valid experiments"] == 2
    assert shown["day 2: error of beta against least squares, largest"] == pytest.approx(30.0)
    assert not next(f for f in figures if "largest" in f.name).met


def test_a_worker_can_call_a_function_that_needs_the_main_thread() -> None:
    with ThreadPoolExecutor(1) as worker:
        call = partial(worker.submit, in_main_thread, signal.signal)
        call(signal.SIGPROF, signal.SIG_IGN).result()
        assert call(signal.SIGPROF, signal.SIG_DFL).result() == signal.SIG_IGN
        with pytest.raises(ValueError, match="signal number"):
            call(1000, signal.SIG_IGN).result()
