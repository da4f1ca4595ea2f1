"""``gcs-autotune tune`` on unmodified ArduPilot with its stock physics, from start to report."""

from __future__ import annotations

import json

import pytest
from tuning import QUICK, assert_left_alone, command_line, gains_of, steady_velocity, summary_of

from gcs_autotune.firmware import ALIASES, FIRMWARE

pytestmark = [pytest.mark.ardupilot, pytest.mark.timeout(600)]

MANUAL_ROVER, MANUAL_SUB = 0, 19
ENDINGS = {"kept": 0, "unchanged": 0, "restored": 8}


def flown(firmware, witness, axis, tmp_path, mode, *options):
    """Tune, and check that the vehicle holds the gains that the run reports; return the summary and the fit."""
    run = tmp_path / "run"
    known = FIRMWARE["ardurover" if mode == MANUAL_ROVER else "ardusub"].axes[axis]
    names = [witness.name_of(name, *(a.name for a in ALIASES.get(name, ()))) for name in gains_of(known)]
    before = witness.parameters(names)
    done = command_line("tune", axis, "--connect", firmware.uri, "--yes", "--out", str(run), *QUICK, *options)
    assert (run / "summary.json").exists(), done.stderr
    summary = summary_of(run)
    assert done.returncode == ENDINGS.get(summary["ending"]), done.stderr
    kept = summary["ending"] == "kept"
    expected = {**before, **({name: new for name, (_, new) in summary["gains"].items()} if kept else {})}
    after = witness.parameters(names)
    assert after == {name: pytest.approx(value, rel=1e-6) for name, value in expected.items()}
    assert_left_alone(witness, after, mode)
    assert (run / "report.html").stat().st_size > 10_000
    assert "NaN" not in (run / "report.html").read_text()
    for name, value in before.items():
        witness.set_parameter(name, value)
    return summary, json.loads((run / "fit.json").read_text())


def test_heading_of_the_stock_boat_is_improved(rover, witness, tmp_path):
    """Its model turns at once: 1.183 rad/s per m/s and full rudder, less at larger angles (SIM_Sailboat)."""
    summary, fit = flown(rover, witness, "heading", tmp_path, MANUAL_ROVER)
    speed = 5.0
    assert fit["parameters"]["beta_r"]["value"] == pytest.approx(1.0 / (1.183 * speed), rel=0.3)
    assert summary["ending"] == "kept"
    assert summary["metrics"]["after"]["itae"] < summary["metrics"]["before"]["itae"]


def test_heading_of_the_stock_rov_is_improved(sub, witness, tmp_path):
    """Its steady turn rate is 2.7 rad/s per full output, thrust and drag are both quadratic."""
    summary, _ = flown(sub, witness, "heading", tmp_path, MANUAL_SUB)
    assert steady_velocity(tmp_path / "run", 0.5) == pytest.approx(0.5 * 2.7, rel=0.1)
    assert summary["ending"] == "kept"
    assert summary["metrics"]["after"]["itae"] < summary["metrics"]["before"]["itae"]


def test_depth_of_the_stock_rov_is_tuned_from_the_surface_and_kept_only_if_better(sub, witness, tmp_path):
    """Its steady speed is 1.22 m/s per full output: 2 * 51.48 u|u| N against 69 w|w| N (SIM_Submarine)."""
    summary, _ = flown(sub, witness, "depth", tmp_path, MANUAL_SUB)
    assert steady_velocity(tmp_path / "run", 0.5) == pytest.approx(0.5 * 1.22, rel=0.2)
    metrics = summary["metrics"]
    assert metrics["before"]["itae"] < 0.5, "ArduPilot's own gains follow the requested depth"
    assert summary["ending"] != "kept" or metrics["after"]["itae"] < metrics["before"]["itae"]


def test_a_dry_run_writes_nothing(rover, witness, tmp_path):
    names = gains_of(FIRMWARE["ardurover"].axes["heading"])
    before = witness.parameters(names)
    run = tmp_path / "run"
    done = command_line("tune", "heading", "--connect", rover.uri, "--yes", "--dry-run", "--out", str(run), *QUICK)
    assert done.returncode == 0, done.stderr
    assert summary_of(run)["ending"] == "dry-run"
    assert_left_alone(witness, before, MANUAL_ROVER)
