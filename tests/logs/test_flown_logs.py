"""The tlog of a simulated run, read like a foreign one, describes the same craft as its trials."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from gcs_autotune.identify import fit_axis
from gcs_autotune.logs import load_runs
from gcs_autotune.workflow import Unattended, experiment
from tests.workflow.sitl_harness import SLOW_LOOP, Ear, SitlHarness

pytestmark = pytest.mark.slow


@pytest.mark.parametrize(("name", "axis", "dof"), [("videoray", "heading", "yaw"), ("falcon", "depth", "heave")])
def test_the_log_and_the_trials_of_a_run_agree(tmp_path: Path, name: str, axis: str, dof: str) -> None:
    harness = SitlHarness(tmp_path, name, **SLOW_LOOP)
    experiment(harness.settings(axis), Unattended(), Ear(harness.said), "2026-11-20T12:00:00")
    page = (harness.directory / "report.html").read_text(encoding="utf-8")
    assert f"Experiment: {axis}" in page
    assert page.count("residual [") == page.count("[% of full output]") > 1
    trials = fit_axis(load_runs(harness.directory), dof=dof)
    runs = load_runs(harness.directory / "telemetry.tlog")
    assert all(r.meta["input_from"] == "servo outputs" and r.meta["damaged"] == 0 for r in runs)
    log = fit_axis(runs, dof=dof, structure=trials.structure)
    for name, p in list(trials.parameters.items())[:4]:
        other = log.parameters[name]
        assert abs(p.value - other.value) <= 4.0 * math.hypot(p.std, other.std), name
    assert log.fit_percent > 90.0
