"""An experiment is the first half of a tune: for every axis there is, announced alike, its page left behind."""

from __future__ import annotations

from pathlib import Path

import pytest

from gcs_autotune.axes import axis_kind
from gcs_autotune.workflow import Unattended, experiment

from .sitl_harness import WHEN, Ear, SitlHarness


@pytest.mark.slow
@pytest.mark.parametrize("axis", ["yaw", "speed"])
def test_every_axis_of_a_boat_is_identified_and_reported(axis: str, tmp_path: Path) -> None:
    harness = SitlHarness(tmp_path, "blueboat")
    fit = experiment(harness.settings(axis), Unattended(), Ear(harness.said), WHEN)
    assert fit.dof == axis_kind(axis).dof
    assert fit.fit_percent > 80.0
    announced = " ".join(harness.said)
    assert announced.index("will move") < announced.index("State before the run: mode") < announced.rindex("sign check")
    assert f"experiments in {axis}" in announced
    harness.assert_neutral()
    assert not harness.vehicle.autopilot.armed
    assert dict(harness.vehicle.parameters.values) == harness.parameters
    assert f"Experiment: {axis}" in (harness.directory / "report.html").read_text()
    assert (harness.directory / "model.json").exists()
