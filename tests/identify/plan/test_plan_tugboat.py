"""The whole sequence of Erunsal2017 on its tugboat, on simulated runs, shortened; the benchmark has more."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from tug_plants import TUG, sea_trials

from gcs_autotune.identify.plan import PlanResult, run_plan
from gcs_autotune.identify.plan.plan import PLANS
from gcs_autotune.report import plan_document
from gcs_autotune.report.toolkit.terminal import render_text
from gcs_autotune.trial import Trial

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def trials() -> list[Trial]:
    return sea_trials(5, each=2, scale=0.5, free=15.0)


@pytest.fixture(scope="module")
def result(trials: list[Trial]) -> PlanResult:
    return run_plan(PLANS["usv_6dof"], trials)


def test_all_23_parameters_are_identified_within_their_errors(result: PlanResult):
    assert set(result.parameters) == set(TUG)
    misses = np.array([(p.value - TUG[n]) / p.std for n, p in result.parameters.items()])
    assert np.max(np.abs(misses)) < 4.0
    assert np.sqrt(np.mean(misses**2)) < 1.6


def test_all_parameters_except_the_faintest_are_within_three_percent(result: PlanResult):
    # the heave gauge sees two strokes of a motion gone in a second; Y_r is -0.0001 and N_rdot 2 % of I_z
    faint = {"Z_w", "Z_ww", "Y_r", "N_rdot", "M_qq", "I_xz", "X_udot", "Y_vdot", "X_uu"}
    off = {n: 100.0 * abs(p.value / TUG[n] - 1.0) for n, p in result.parameters.items() if n not in faint}
    assert max(off.values()) < 3.0, off
    assert abs(result.parameters["Y_r"].value - TUG["Y_r"]) < 0.05


def test_every_step_is_validated_on_a_held_out_run(result: PlanResult):
    assert all(s.unseen and s.validation is not None for s in result.steps)
    assert min(s.validation.fit_percent for s in result.steps if s.validation and s.step.name != "roll decay") > 60.0


def test_the_steps_agree_on_shared_parameters(result: PlanResult):
    assert {a.name for a in result.agreements} >= {"X_u", "N_r", "Y_v", "N_rr"}
    assert "steps-disagree" not in {d.slug for d in result.doubts}


def test_the_whole_model_predicts_free_driving(result: PlanResult):
    assert result.final is not None and result.final.fit_percent > 85.0
    assert result.model is not None and len(result.model.form.dofs) == 6
    assert np.all(np.linalg.eigvalsh(result.model.inertia) > 0.0)


def test_the_result_can_be_printed_and_serialised(result: PlanResult):
    text = render_text(plan_document(result), 100)
    assert "drift in wind" in text and "C_DA" in text and "Final validation" in text
    assert json.loads(json.dumps(result.to_dict()["parameters"]))["I_x"]["value"] == pytest.approx(0.0894, rel=0.02)


def test_the_plan_reports_what_it_cannot_identify_without_wind_runs(trials: list[Trial]):
    kinds = {"yaw_swing", "heave_decay", "speed_steps"}
    found = run_plan(PLANS["usv_6dof"], [t for t in trials if t.meta["manoeuvre"] in kinds])
    doubt = next(d for d in found.doubts if d.slug == "steps-without-runs")
    assert "drift in wind" in doubt.cause and "C_DA" in doubt.cause
    assert "C_DA" not in found.parameters and found.model is None
    assert "no-final-validation" in {d.slug for d in found.doubts}


def test_a_craft_that_changed_between_steps_is_reported(trials: list[Trial]):
    # the pull of the second kind of run 20 % stronger than its column states: another load, or a fouled propeller
    kinds = {"speed_steps", "spiral", "yaw_swing", "yaw_turn"}
    own = [t for t in trials if t.meta["manoeuvre"] in kinds]
    changed = [
        replace(t, channels={n: replace(c, values=0.8 * c.values) if n == "X" else c for n, c in t.channels.items()})
        if t.meta["manoeuvre"] == "speed_steps"
        else t
        for t in own
    ]
    assert "steps-disagree" in {d.slug for d in run_plan(PLANS["usv_6dof"], changed).doubts}
