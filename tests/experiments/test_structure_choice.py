"""The structure is decided by held-out data and the criterion, and the reason is reported."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from experiment_plants import Steps, recorded

from gcs_autotune.errors import UsageError
from gcs_autotune.experiments import choose_form, eliminate, weigh_drags
from gcs_autotune.experiments.cross_validation import folds_of
from gcs_autotune.experiments.form_choice import droppable
from gcs_autotune.identify import fit_axis
from gcs_autotune.models import FORMS, Form
from gcs_autotune.trial import Channel, Trial

SURGE = Form(
    "surge", "surge", ("surge",), ("X_udot", "X_u", "X_uu", "X_0"), {}, {"X": (("X", 1.0),)}, coriolis=False,
    start={"X_udot": -20.0, "X_u": -4.0, "X_uu": -3.0},
)  # fmt: skip


def pushed(seed: int, X_u: float, X_uu: float, X_0: float = 0.0, seconds: float = 40.0) -> Trial:
    """Surge alone, a mass of 25 kg under random levels of thrust, by small Euler steps."""
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, seconds, 0.1)
    X = np.repeat(rng.uniform(-20.0, 30.0, len(t) // 40 + 1), 40)[: len(t)]
    u, out = 0.0, []
    for push in X:
        out.append(u)
        for _ in range(100):
            u += 0.001 * (push + X_0 + (X_u + X_uu * abs(u)) * u) / 25.0
    noisy = np.array(out) + rng.normal(0.0, 0.02, len(t))
    return Trial(f"run {seed}", {"u": Channel("u", "m/s", t, noisy), "X": Channel("X", "N", t, X)})


def test_absent_terms_are_dropped_with_the_evidence() -> None:
    runs = [pushed(seed, -6.0, 0.0) for seed in (1, 2, 3)]
    choice = eliminate(runs, SURGE)
    assert set(choice.chosen.form.free) == {"X_udot", "X_u"}
    (quadratic,) = (r for r in choice.reasons if r.startswith("X_uu"))
    assert "is not supported" in quadratic and "held-out" in quadratic and "BIC" in quadratic
    assert choice.chosen.left_out <= choice.table[0].left_out * 1.02


def test_present_terms_are_kept() -> None:
    runs = [pushed(seed, -3.0, -5.0, 2.0) for seed in (1, 2, 3)]
    choice = eliminate(runs, SURGE)
    assert choice.chosen.form.free == SURGE.free
    assert all("needed" in r and "not" not in r for r in choice.reasons)


def test_forms_are_compared_on_one_run_cut_in_time() -> None:
    run = pushed(4, -3.0, -5.0)
    rivals = [
        replace(SURGE.without("X_uu", "X_0"), name="linear"),
        replace(SURGE.without("X_u", "X_0"), name="quadratic"),
        replace(SURGE.without("X_0"), name="both"),
        replace(SURGE, name="both and constant"),
    ]
    choice = choose_form(run, rivals)
    assert choice.chosen.form.name == "both"
    by_name = {row.form.name: row for row in choice.table}
    assert by_name["linear"].left_out > 1.2 * by_name["both"].left_out
    assert by_name["linear"].bic > by_name["both"].bic + 10.0
    assert len(by_name["both"].per_fold) == 4
    assert any("'both' instead of 'both and constant': X_0 (not needed)" in r for r in choice.reasons)
    assert choice.to_dict()["chosen"] == "both"


def test_a_form_with_driving_drag_is_reported_and_not_chosen() -> None:
    runs = [pushed(seed, -6.0, 0.0) for seed in (1, 2)]
    backwards = replace(
        SURGE.without("X_0"), name="driving", inputs={"X": (("X", -1.0),)}, start={"X_udot": 20.0, "X_u": 4.0}
    )
    choice = choose_form(runs, [backwards, SURGE])
    bad = next(row for row in choice.table if row.form.name == "driving")
    assert "its inertia is not positive" in bad.complaints
    assert choice.chosen.form.name == "surge"


def test_useless_coupled_terms_are_dropped_and_useful_ones_kept() -> None:
    runs = [recorded(Steps(seed), 20.0, seed, name=f"run {seed}", scale=2.0) for seed in (1, 2)]
    form = FORMS["horizontal"].without("Y_rdot", "X_0", "Y_0", "Y_vv")
    form = form.fixing(
        {"X_udot": -25.0, "X_u": -3.5, "X_uu": -4.0, "Y_v": -30.0, "Y_vdot": -27.0, "N_r": -4.0, "Y_r": -1.4}
    )
    form = replace(form, start={"N_rdot": -2.5, "N_v": 2.0, "N_rr": -1.0})
    choice = eliminate(runs, form)
    assert "N_0" not in choice.chosen.form.free
    assert {"N_v", "N_rr"} <= set(choice.chosen.form.free)


def test_inertia_and_input_gains_are_never_dropped() -> None:
    form = Form("f", "f", ("surge", "yaw"), ("X_udot", "N_rdot", "X_u", "N_r", "k_N", "N_0"), {},
                {"N": (("N", "k_N"),)})  # fmt: skip
    assert droppable(form) == ("X_u", "N_r", "N_0")


def test_forms_with_different_inputs_are_rejected() -> None:
    other = replace(SURGE, inputs={"n": (("X", 1.0),)})
    with pytest.raises(UsageError, match="different inputs"):
        choose_form(pushed(1, -6.0, 0.0), [SURGE, other])
    with pytest.raises(UsageError, match="does not fit coupled"):
        choose_form(pushed(1, -6.0, 0.0), [SURGE], method="iso")


def test_a_block_of_a_run_begins_with_the_active_input() -> None:
    t = np.arange(0.0, 40.0, 0.1)
    run = Trial(
        "r", {"u": Channel("u", "m/s", t, t), "X": Channel("X", "N", np.array([0.0, 12.0]), np.array([1.0, 2.0]))}
    )
    folds = folds_of([run], ["X"])
    third = folds[2].held[0]
    assert third["X"].t[0] == pytest.approx(third["u"].t[0], abs=0.1)
    assert third["X"].values.tolist() == [2.0]
    assert sum(len(fold.held[0]["u"]) for fold in folds) == len(t)
    assert all(len(fold.train) == 3 for fold in folds)


def test_the_drag_of_one_axis_is_chosen_with_its_evidence() -> None:
    runs = [pushed(seed, 0.0, -6.0) for seed in (1, 2)]
    made = fit_axis(runs, dof="surge", delay=0.0)
    choice = weigh_drags(made, runs)
    left_out = {row.structure: row.left_out for row in choice.table}
    assert choice.chosen == "nonlinear"
    assert left_out["linear"] > 1.2 * left_out["nonlinear"]
    assert any("quadratic damping predicts best" in r for r in choice.reasons)
    assert any("Bayesian information criterion" in r for r in choice.reasons)
    assert not any("disagree" in r for r in choice.reasons)
    assert choice.to_dict()["table"][0]["structure"] == "linear"


def test_only_the_structure_with_the_least_error_is_called_best() -> None:
    runs = [pushed(seed, -6.0, 0.0) for seed in (8, 9)]  # here both terms together predict slightly better
    choice = weigh_drags(fit_axis(runs, dof="surge", delay=0.0), runs)
    left_out = {row.structure: row.left_out for row in choice.table}
    assert choice.chosen == "linear" and left_out["affine"] < left_out["linear"]
    assert "linear damping predicts about as well as linear and quadratic damping" in choice.reasons[0]


def test_criteria_that_disagree_make_the_choice_of_drag_uncertain() -> None:
    # One craft with linear and one with quadratic drag look affine together, but neither predicts the other.
    runs = [pushed(1, -6.0, 0.0), pushed(2, 0.0, -6.0)]
    choice = weigh_drags(fit_axis(runs, dof="surge", structure="affine", delay=0.0), runs)
    assert any("the criteria disagree" in reason for reason in choice.reasons)


def test_no_structure_is_reported_as_best_if_none_can_predict() -> None:
    runs = [pushed(1, -6.0, 0.0, seconds=9.0)]
    choice = weigh_drags(fit_axis(runs, dof="surge", delay=0.0), runs)
    assert not any(math.isfinite(row.left_out) for row in choice.table)
    assert (
        "4 parts of the run held out in turn (surge velocity, delay 0 s): not each can be predicted from the others"
        in choice.reasons
    )
