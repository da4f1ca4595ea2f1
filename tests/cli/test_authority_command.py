"""``authority``: prints a page and JSON from model files, saves parameters, rejects unrelated models."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from gcs_autotune.cli import main
from gcs_autotune.mavlink import load_params
from gcs_autotune.trial import Channel, Trial, save_trial

SETTINGS = "SERVO1_FUNCTION,26\nCRUISE_THROTTLE,50\nMOT_SLEWRATE,0\n"


def model(folder: Path, dof: str, **numbers: float | str) -> str:
    """Write a model of one degree of freedom and return its path."""
    data = {"schema": 1, "model": "single-dof", "dof": dof, "input_unit": "1", "alpha": 0.4, "beta": 0.25, **numbers}
    path = folder / f"{dof}-{len(list(folder.iterdir()))}.json"
    path.write_text(json.dumps({"beta_quadratic": 0.0, "delta": 0.0, "delay": 0.0, **data}))
    return str(path)


@pytest.fixture
def words(tmp_path: Path) -> list[str]:
    """Return the arguments of the models of a boat with a rudder."""
    (tmp_path / "boat.param").write_text(SETTINGS)
    models = [model(tmp_path, "surge"), model(tmp_path, "yaw", alpha=1.0, beta=1.5)]
    return ["authority", *models, "--parameters", str(tmp_path / "boat.param")]


@pytest.mark.slow
def test_page_parameters_and_rules_are_written(
    words: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    saved, page = tmp_path / "limits.param", tmp_path / "boat.html"
    assert main([*words, "--save", str(saved), "--page", str(page)]) == 0
    output = " ".join(capsys.readouterr().out.replace("│", " ").split())
    assert "The craft makes 2 m/s at 50 % throttle, turns at 38.2°/s at full steering and stops in 2.88 m" in output
    assert "stopping --throttle 1 --astern 1" in output
    assert "the file contains no covariance" in output
    values = load_params(saved)
    assert values["CRUISE_SPEED"] == pytest.approx(2.0, rel=0.01)
    assert "# ATC_STR_RAT_MAX: 80 % of the turn rate" in saved.read_text()
    assert "ATC_STR_RAT_MAX" in page.read_text()


def test_json_has_every_figure_with_its_interval(words: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert main([*words, "--json", "--throttle", "0.25"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["throttle"] == 0.25
    assert document["figures"]["cruise-speed"]["value"] == pytest.approx(1.0, rel=0.01)
    assert {"low", "high", "unit"} <= set(document["figures"]["top-ahead"])
    assert {row["name"] for row in document["limits"]} >= {"ATC_STR_RAT_MAX", "WP_SPEED", "TURN_RADIUS"}


def test_an_extrapolated_figure_shows_the_word_in_place_of_an_interval(
    words: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    t, folder = np.arange(20.0), tmp_path / "slow"
    (folder / "trials").mkdir(parents=True)
    save_trial(Trial("slow", {"X": Channel("X", "1", t, t / 40.0)}), folder / "trials" / "01-slow.csv")
    Path(words[1]).rename(folder / "model.json")
    slow = ["authority", str(folder), *words[2:]]
    assert main(slow) == 0
    rows = capsys.readouterr().out.splitlines()
    assert any("top speed ahead" in row and "extrapolated" in row for row in rows)
    assert not any("speed at 50 % throttle" in row and "extrapolated" in row for row in rows)
    assert main([*slow, "--json"]) == 0
    figure = json.loads(capsys.readouterr().out)["figures"]["top-ahead"]
    assert (figure["extrapolated"], figure["low"], figure["high"]) == (True, None, None)


def test_models_that_do_not_belong_together_are_rejected(
    words: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["authority", model(tmp_path, "surge"), *words[1:]]) == 2
    assert "several models of surge" in capsys.readouterr().err
    assert main(["authority", model(tmp_path, "yaw", alpha=1.0), *words[1:]]) == 2
    assert "Give its run directory" in capsys.readouterr().err
    assert main(["authority", model(tmp_path, "heave")]) == 2
    assert "surge or yaw" in capsys.readouterr().err


def test_runs_of_different_boards_are_an_assumption(
    words: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    t = np.arange(20.0)
    for dof, board in (("surge", "1f"), ("yaw", "2e")):
        (tmp_path / dof / "trials").mkdir(parents=True)
        trial = Trial(dof, {"X": Channel("X", "1", t, t / 40.0)}, meta={"vehicle": {"uid": board}})
        save_trial(trial, tmp_path / dof / "trials" / f"01-{dof}.csv")
        Path(model(tmp_path, dof, alpha=1.0)).rename(tmp_path / dof / "model.json")
    runs = [str(tmp_path / dof) for dof in ("surge", "yaw")]
    assert main(["authority", *runs, "--throttle", "0.5"]) == 0
    assert "although their autopilot boards differ" in " ".join(capsys.readouterr().out.split())
    assert main(["authority", runs[0], *words[2:3], "--throttle", "0.5"]) == 0
    assert "autopilot boards" not in capsys.readouterr().out


def test_a_missing_model_and_an_input_in_newtons_are_rejected_with_advice(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "run").mkdir()
    assert main(["authority", str(tmp_path / "run")]) == 6
    assert "gcs-autotune identify" in capsys.readouterr().err
    newtons = model(tmp_path, "surge", input_unit="N", alpha=40.0, beta=25.0)
    assert main(["authority", newtons]) == 2
    assert "--full-scale" in capsys.readouterr().err
    assert main(["authority", newtons, "--full-scale", "X=50", "--throttle", "1", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["figures"]["top-ahead"]["value"] == pytest.approx(2.0, rel=0.01)
