"""CSV files of other tools: headers with various units and names."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from gcs_autotune.cli import main
from gcs_autotune.errors import BadFile, UsageError
from gcs_autotune.identify import fit_axis
from gcs_autotune.logs import load_runs, parse_columns, renamed
from gcs_autotune.trial import load_trial

DATA = Path(__file__).parents[2] / "../shared/data"
needs_data = pytest.mark.skipif(not DATA.is_dir(), reason="the shared data folder is not beside this checkout")


def csv(path: Path, head: str, *rows: str) -> Path:
    path.write_text("\n".join((head, *rows)) + "\n")
    return path


def test_units_of_ordinary_headers_are_converted_to_si(tmp_path: Path) -> None:
    head = "t[ms],psi[deg],r[deg/s],delta[deg],n[rev/s],pwm_left[us],servo3[us],lat[deg],U[kn]"
    run = load_trial(csv(tmp_path / "a.csv", head, "1500,180,90,-10,2,1510,1490,60,10"))
    assert run["psi"].t[0] == 1.5
    assert {n: (c.unit, round(float(c.values[0]), 6)) for n, c in run.channels.items()} == {
        "psi": ("rad", round(math.pi, 6)),
        "r": ("rad/s", round(math.pi / 2, 6)),
        "delta": ("rad", round(-math.pi / 18, 6)),
        "n": ("rad/s", round(4 * math.pi, 6)),
        "pwm_left": ("pwm", 1510.0),
        "servo3": ("pwm", 1490.0),
        "lat": ("rad", round(math.pi / 3, 6)),
        "U": ("m/s", 5.144444),
    }


def test_foreign_column_names_are_mapped_by_the_user(tmp_path: Path) -> None:
    path = csv(tmp_path / "a.csv", "time_ms,heading,cmd", "100,90,0.5", "200,180,-0.5")
    (run,) = load_runs(path, columns=parse_columns("time_ms=t[ms], heading=psi[deg],cmd=N"))
    assert list(run["psi"].t) == [0.1, 0.2]
    assert np.allclose(run["psi"].values, [math.pi / 2, math.pi])
    assert (run["N"].unit, list(run["N"].values)) == ("1", [0.5, -0.5])


@pytest.mark.parametrize("text", ["a", "a=", "=psi[deg]", "a=psi,b=psi", "a=psi,a=r", "a=psi[deg"])
def test_an_invalid_mapping_is_rejected(text: str) -> None:
    with pytest.raises((UsageError, BadFile)):
        parse_columns(text)


def test_a_missing_column_is_a_usage_error_that_lists_the_columns(tmp_path: Path) -> None:
    path = csv(tmp_path / "a.csv", "t[s],heading", "1,2")
    with pytest.raises(UsageError, match=r"no column course\. Its columns are t, heading"):
        load_runs(path, columns={"course": "psi[deg]"})


def test_two_columns_with_the_same_name_are_rejected(tmp_path: Path) -> None:
    with pytest.raises(BadFile, match="more than one column called psi"):
        load_trial(csv(tmp_path / "a.csv", "t[s],psi[rad],psi[deg]", "1,2,3"))


def test_a_channel_with_a_unit_keeps_its_values_and_rejects_another_unit(tmp_path: Path) -> None:
    run = load_trial(csv(tmp_path / "a.csv", "t[s],heading[deg],cmd", "1,180,40", "2,90,20"))
    there = renamed(run, {"heading": "psi[rad]", "cmd": "N[%]"})
    assert there["psi"].values[0] == pytest.approx(math.pi)
    assert list(there["N"].values) == [0.4, 0.2]
    with pytest.raises(UsageError, match="is in rad"):
        renamed(run, {"heading": "x[m]"})
    with pytest.raises(UsageError, match="two channels called cmd"):
        renamed(run, {"heading": "cmd[rad]"})


@needs_data
@pytest.mark.parametrize("folder", ["kvlcc2_hsva", "blueboat"])
def test_measured_sets_load_with_their_own_headers(folder: str) -> None:
    runs = load_runs(DATA / folder)
    assert len(runs) > 1
    for run in runs:
        assert {"psi", "r", "u", "v"} <= set(run.channels)
        assert float(np.max(np.abs(run["r"].values))) < 2.0
        assert not run.meta.get("notes")


@needs_data
def test_measured_sets_are_identified_without_doubts_about_units() -> None:
    found = fit_axis(load_trial(DATA / "kvlcc2_hsva" / "Z_20_10_P.csv"), dof="yaw")
    assert not {d.slug for d in found.doubts} & {"unit", "sign", "clipped"}
    assert found.parameters["alpha_r"].value < 0.0  # positive rudder turns to port there


@pytest.mark.slow
@needs_data
def test_foreign_columns_are_identified_from_the_command_line(capsys: pytest.CaptureFixture[str]) -> None:
    columns = "t_sim=t[s],heading_deg=psi[deg],yawrate_dps=r[deg/s],cmd=N"
    path = DATA / "ardupilot_sitl" / "rover_relay_C0.2_h5.csv"
    assert main(["identify", str(path), "--columns", columns, "--no-check", "--no-page"]) == 0
    assert "alpha_r" in capsys.readouterr().out
