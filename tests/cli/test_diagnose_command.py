"""``gcs-autotune diagnose`` as typed."""

from __future__ import annotations

import json
import math
from types import SimpleNamespace

import numpy as np
import pytest

from gcs_autotune import clock
from gcs_autotune.cli import main
from gcs_autotune.effects import EFFECTS
from gcs_autotune.errors import UsageError
from gcs_autotune.workflow import DiagnosisSettings

WIDTH, DT, INERTIA, DRAG, NOISE = 0.3, 0.1, 2.0, 1.0, 0.004
FAST = ("--effects", "dead-zone,input-bias")


def run(capsys, *arguments):
    code = main([str(a) for a in arguments])
    out, err = capsys.readouterr()
    return code, out, err


def record(path, seed, width=0.0, n=300):
    """Write a run of 2 r' + r = N less a dead zone, exact between samples, with noise."""
    rng = np.random.default_rng(seed)
    command = np.repeat(rng.uniform(-1.0, 1.0, n // 20), 20)
    acting = np.sign(command) * np.maximum(np.abs(command) - width, 0.0)
    psi, r, decay = 0.3, 0.0, math.exp(-DT * DRAG / INERTIA)
    rows = []
    for k in range(n):
        noise = rng.normal(0.0, NOISE, 2)
        rows.append((k * DT, math.degrees(psi + noise[0]), r + noise[1], command[k]))
        steady = acting[k] / DRAG
        psi += steady * DT + (r - steady) * (1.0 - decay) * INERTIA / DRAG
        r = steady + (r - steady) * decay
    np.savetxt(path, rows, delimiter=",", header="t[s],psi[deg],r[rad/s],N[N m]", comments="", fmt="%.6f")
    return path


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    folder = tmp_path_factory.mktemp("runs")
    return [record(folder / f"hidden-{seed}.csv", seed, WIDTH) for seed in (1, 2, 3)]


@pytest.fixture(scope="module")
def found(runs, tmp_path_factory):
    """A diagnosis with its files; what it wrote."""
    out = tmp_path_factory.mktemp("found")
    assert main(["diagnose", *map(str, runs[:2]), "--validate", str(runs[2]), *FAST, "--out", str(out)]) == 0
    return out


@pytest.mark.slow
def test_a_hidden_dead_zone_is_identified_and_three_files_are_written(found):
    assert sorted(p.name for p in found.iterdir()) == ["diagnosis.json", "model.json", "report.html"]
    document = json.loads((found / "diagnosis.json").read_text())
    assert document["causes"][0] == "dead-zone"
    width = document["found"][0]["parameters"]["width"]
    assert width["value"] == pytest.approx(WIDTH, abs=max(5.0 * width["std"], 1e-3))
    assert document["gain"]["ratio"] < 0.2
    assert document["held_out"] == ["hidden-3"]
    page = (found / "report.html").read_text(encoding="utf-8")
    assert "dead zone on yaw moment (N)" in page
    assert f"--model {found}/model.json" in page


@pytest.mark.slow
def test_the_extended_model_explains_the_runs_it_was_made_for(capsys, runs, found):
    code, out, _ = run(
        capsys, "diagnose", runs[2], "--model", found / "model.json", "--effects", "input-bias", "--json"
    )
    assert code == 0
    document = json.loads(out)
    assert document["verdict"] == "no-effect"
    assert [e["slug"] for e in document["base_model"]["effects"]] == ["dead-zone"]


def test_the_json_of_a_diagnosis_can_be_used_as_its_model(capsys, runs, found):
    code, out, _ = run(
        capsys, "diagnose", runs[2], "--model", found / "diagnosis.json", "--effects", "gyro-bias", "--json"
    )
    assert code == 0
    assert json.loads(out)["base_model"]["effects"][0]["slug"] == "dead-zone"


@pytest.fixture
def starved(monkeypatch):
    """A clock on which every look takes ten minutes."""
    looks = [0.0]

    def now():
        looks[0] += 600.0
        return looks[0]

    with monkeypatch.context() as patch:
        patch.setattr(clock, "time", SimpleNamespace(monotonic=now))
        yield patch


@pytest.mark.slow
def test_a_stopped_search_names_resume_and_ends_like_a_complete_one(capsys, tmp_path, runs, starved):
    out = tmp_path / "out"
    command = ("diagnose", runs[0], runs[1], *FAST)
    code, text, _ = run(capsys, *command, "--max-seconds", 3600, "--out", out)
    assert code == 0
    assert "Unfinished" in text and f"--resume {out}" in " ".join(text.split())
    assert sorted(p.name for p in out.iterdir()) == ["diagnosis.json", "report.html", "search.jsonl"]
    document = json.loads((out / "diagnosis.json").read_text())
    assert (document["verdict"], document["causes"]) == ("unfinished", [])
    starved.undo()
    code, text, err = run(capsys, "diagnose", runs[2], *FAST, "--resume", out)
    assert code == 6 and "other runs, other options" in err
    code, text, _ = run(capsys, *command, "--resume", out)
    assert code == 0
    assert sorted(p.name for p in out.iterdir()) == ["diagnosis.json", "model.json", "report.html"]
    document = json.loads((out / "diagnosis.json").read_text())
    code, text, _ = run(capsys, *command, "--json")
    whole = json.loads(text)
    assert document["causes"] == whole["causes"] == ["dead-zone"]
    code, _, err = run(capsys, *command, "--resume", out)
    assert code == 2 and "contains no stopped search" in err


def test_a_diagnosis_json_next_to_a_run_is_not_a_side_file(capsys, tmp_path, runs):
    mine = tmp_path / "mine.csv"
    mine.write_bytes(runs[0].read_bytes())
    for _ in range(2):
        code, out, err = run(capsys, "diagnose", mine, *FAST, "--json")
        assert (code, err) == (0, "")
        mine.with_suffix(".json").write_text(out)


def test_json_is_the_only_output_and_nothing_is_written(capsys, tmp_path, monkeypatch, runs):
    monkeypatch.chdir(tmp_path)
    code, out, err = run(capsys, "diagnose", runs[0], *FAST, "--json")
    assert code == 0
    assert err == ""
    document = json.loads(out)
    assert {"verdict", "causes", "ranking", "indistinguishable", "gain", "base_model", "extended_model"} <= set(
        document
    )
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_without_out_the_folder_is_named_after_the_first_run(capsys, tmp_path, monkeypatch, runs):
    monkeypatch.chdir(tmp_path)
    code, out, _ = run(capsys, "diagnose", runs[0], runs[1], *FAST)
    assert code == 0
    assert "dead zone on yaw moment (N)" in " ".join(out.split())
    assert "Report: diagnose-hidden-1" in out
    assert (tmp_path / "diagnose-hidden-1" / "report.html").exists()


def test_excluded_effects_are_not_tried():
    tried = DiagnosisSettings(without=("dead-zone", "outliers")).slugs()
    assert tried == tuple(slug for slug in EFFECTS if slug not in ("dead-zone", "outliers"))
    assert DiagnosisSettings().slugs() is None
    with pytest.raises(UsageError, match="no effect to try"):
        DiagnosisSettings(effects=("outliers",), without=("outliers",)).slugs()


def test_the_effects_are_listed_as_text_and_json(capsys):
    code, out, _ = run(capsys, "diagnose", "--list-effects")
    assert code == 0
    assert "dead-zone" in out
    code, out, _ = run(capsys, "diagnose", "--list-effects", "--json")
    assert code == 0
    assert "compass-deviation" in {e["slug"] for e in json.loads(out)["effects"]}


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ((), "no run given"),
        (("RUN", "--effects", "dead-zon"), "Did you mean dead-zone"),
        (("RUN", "--without", "gremlins"), "unknown effect 'gremlins'"),
    ],
)
def test_a_wrong_command_exits_with_2_and_a_reason(capsys, runs, arguments, said):
    code, out, err = run(capsys, "diagnose", *(runs[0] if a == "RUN" else a for a in arguments))
    assert code == 2
    assert out == ""
    assert said in err


def test_a_file_that_is_not_a_model_is_rejected_by_name(capsys, tmp_path, runs):
    for text in ("no json", "[1]", '{"schema": 1}', '{"model": "coupled"}', '{"model": {"model": "thruster"}}'):
        wrong = tmp_path / "wrong.json"
        wrong.write_text(text)
        code, _, err = run(capsys, "diagnose", runs[0], "--model", wrong, *FAST)
        assert code == 6
        assert "wrong.json" in err


@pytest.mark.parametrize(
    "option", [("--effects", "dead-zone"), ("--max-seconds", "3"), ("--dof", "yaw"), ("--jobs", "2")]
)
def test_a_table_of_parameters_rejects_the_options_of_runs(tmp_path, capsys, option):
    (tmp_path / "table.csv").write_text("level,inertia,drag\n1,2,3\n2,2,3\n3,2,3\n4,2,3\n")
    assert main(["diagnose", str(tmp_path / "table.csv"), *option]) == 2
    assert f"so {option[0]} cannot apply" in capsys.readouterr().err
