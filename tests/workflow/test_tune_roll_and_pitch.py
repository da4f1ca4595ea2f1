"""Whole tunes of roll and pitch on the simulated BlueROV2 Heavy in six degrees of freedom."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from gcs_autotune.craft import Observation
from gcs_autotune.errors import WrongVehicle
from gcs_autotune.logs import load_runs
from gcs_autotune.manoeuvres import Envelope
from gcs_autotune.workflow.announcement import room
from gcs_autotune.workflow.excursion import Excursion

from .sitl_harness import SitlHarness


@pytest.mark.slow
@pytest.mark.parametrize(("axis", "letters", "signal"), [("roll", "RLL", "phi"), ("pitch", "PIT", "theta")])
def test_a_tune_keeps_gains_proved_better_by_a_measured_step(
    axis: str, letters: str, signal: str, tmp_path: Path
) -> None:
    harness = SitlHarness(tmp_path, "bluerov2-6dof")  # at 400 Hz: a loop of 100 Hz is too slow for these margins
    story = harness.tune(axis=axis)
    after = dict(harness.vehicle.parameters.values)
    changed = {n for n, v in after.items() if v != harness.parameters[n]}
    assert story.ending == "kept"
    assert changed <= {f"ATC_RAT_{letters}_P", f"ATC_RAT_{letters}_I", f"ATC_RAT_{letters}_D", f"ATC_ANG_{letters}_P"}
    assert story.metrics_after.itae < story.metrics_before.itae
    (step,) = load_runs(next(harness.directory.glob("trials/*-step-after.csv")))
    low, high = np.percentile(step[signal].values, (20.0, 80.0))  # the levels before, on and after the step
    assert high - low == pytest.approx(math.radians(20.0), rel=0.2)
    harness.assert_neutral()
    assert not harness.vehicle.autopilot.armed


def test_a_frame_without_a_pitch_motor_is_refused_before_anything_moves(tmp_path: Path) -> None:
    harness = SitlHarness(tmp_path, "bluerov2-6dof", parameters={"FRAME_CONFIG": 1.0})
    with pytest.raises(WrongVehicle, match="drives M on this FRAME_CONFIG, so it has no pitch loop to tune"):
        harness.tune(axis="pitch")
    harness.assert_untouched()


def test_the_angle_at_which_a_run_ends_is_announced(tmp_path: Path) -> None:
    settings = SitlHarness(tmp_path).settings("pitch", envelope=Envelope(pitch=math.radians(30.0)))
    reported = room("pitch", 0.0, settings, Observation(0.0, 0.0, z=2.0), Excursion(60.0, 2.0))
    assert "More than 30 deg of pitch ends the run (--max-pitch)" in reported.text
