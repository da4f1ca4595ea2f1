"""``gcs-autotune logs``: the contents of a log are shown, its runs are written, and other commands read them."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from log_writing import BOAT, Tlog, beats, parameters, sail, swing

from gcs_autotune.cli import main
from gcs_autotune.identify import fit_axis
from gcs_autotune.logs import load_runs


@pytest.fixture
def dive(tmp_path: Path) -> Path:
    log = Tlog()
    parameters(log, {**BOAT, "INS_GYRO_FILTER": 4})
    sail(log, swing(80.0))
    beats(log, 0.0, 40.0, armed=True, mode=0)
    beats(log, 40.0, 60.0, armed=True, mode=15)
    beats(log, 60.0, 80.0, armed=False, mode=15)
    return log.write(tmp_path / "dive.tlog")


def test_imported_runs_are_identified_like_the_log_itself(
    tmp_path: Path, dive: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["logs", "import", str(dive), "--out", str(tmp_path / "runs")]) == 0
    assert "dive-01-MANUAL.csv" in capsys.readouterr().out
    names = sorted(p.name for p in (tmp_path / "runs").iterdir())
    assert names == [
        "dive-01-MANUAL.csv", "dive-01-MANUAL.json", "dive-02-GUIDED.csv", "dive-02-GUIDED.json", "dive.log.json",
        "dive.param",
    ]  # fmt: skip
    runs = load_runs(tmp_path / "runs")
    assert runs[0].meta["filters"]["r"]["parameter"] == "INS_GYRO_FILTER"
    found = fit_axis(runs, dof="yaw", structure="linear")
    direct = fit_axis(load_runs(dive), dof="yaw", structure="linear")
    for name, p in direct.parameters.items():
        assert found.parameters[name].value == pytest.approx(p.value, rel=1e-3, abs=1e-5), name


def test_a_list_writes_nothing_and_shows_what_runs_may_identify(
    tmp_path: Path, dive: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    before = sorted(tmp_path.rglob("*"))
    assert main(["logs", "list", str(dive)]) == 0
    shown = capsys.readouterr().out
    for text in (
        "telemetry log",
        "ArduRover (system 1)",
        "ATTITUDE",
        "dive#2 GUIDED 40-60 s",
        "yaw: possibly usable",
        "after 1 min 00 s disarmed",
    ):
        assert text in shown
    assert main(["logs", "import", str(dive), "--dry-run", "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert [run["name"] for run in document["logs"][0]["runs"]] == ["dive#1 MANUAL 0-40 s", "dive#2 GUIDED 40-60 s"]
    assert document["written"] == []
    assert sorted(tmp_path.rglob("*")) == before


def test_a_log_of_a_vehicle_that_was_never_armed_is_reported_as_such(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = Tlog()
    parameters(log, BOAT)
    sail(log, swing(30.0))
    beats(log, 0.0, 30.0, armed=False)
    assert main(["logs", "list", str(log.write(tmp_path / "idle.tlog"))]) == 0
    shown = " ".join(capsys.readouterr().out.split())
    assert "no run to identify from. The vehicle was never armed." in shown
    assert "Timeline: MANUAL; disarmed." in shown


def test_a_parameter_file_supplies_the_missing_servo_functions(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = Tlog()
    beats(log, 0.0, 30.0, armed=True)
    sail(log, swing(30.0))
    path = log.write(tmp_path / "bare.tlog")
    assert main(["logs", "import", str(path), "--out", str(tmp_path / "a")]) == 6
    assert "--parameters" in capsys.readouterr().out
    (tmp_path / "boat.param").write_text("".join(f"{n},{v}\n" for n, v in BOAT.items()))
    known = ["--parameters", str(tmp_path / "boat.param")]
    assert main(["logs", "import", str(path), "--out", str(tmp_path / "b"), *known]) == 0
    assert main(["identify", str(path), "--dof", "yaw", "--no-check", "--no-page", *known]) == 0
    (run,) = load_runs(tmp_path / "b")
    assert set(np.unique(run["N"].values)) == {-0.4, 0.4}


def test_runs_are_never_overwritten_and_names_never_collide(
    tmp_path: Path, dive: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    other = tmp_path / "other" / "dive.tlog"
    other.parent.mkdir()
    other.write_bytes(dive.read_bytes())
    out = tmp_path / "runs"
    assert main(["logs", "import", str(dive), str(other), "--out", str(out)]) == 0
    assert len(list(out.glob("*.csv"))) == 4
    assert main(["logs", "import", str(dive), "--out", str(out)]) == 2
    assert "already contains runs" in capsys.readouterr().err


def test_uninformative_segments_are_written_only_on_request(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    head = "Timestamp,roll,pitch,heading,groundSpeed\n"
    rows = "".join(f"2026-05-01 12:00:{s:02d}.000,1,2,{s},0.5\n" for s in range(60))
    (tmp_path / "vehicle1.csv").write_text(head + rows)
    assert main(["logs", "import", str(tmp_path / "vehicle1.csv"), "--out", str(tmp_path / "a")]) == 6
    assert main(["logs", "import", str(tmp_path / "vehicle1.csv"), "--out", str(tmp_path / "b"), "--all"]) == 0
    (run,) = load_runs(tmp_path / "b")
    assert run["psi"].values[-1] == pytest.approx(np.radians(59.0))
    (tmp_path / "table.csv").write_text("t[s],psi[rad]\n0,1\n")
    assert main(["logs", "list", str(tmp_path / "table.csv")]) == 6
    assert "needs no import" in capsys.readouterr().err
