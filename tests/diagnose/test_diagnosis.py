"""From runs to a verdict: causes, no cause, pairs, supplied models, foreign simulators."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from open_loop_runs import towed

from gcs_autotune.diagnose import diagnose
from gcs_autotune.diagnose.candidates import EffectCandidate
from gcs_autotune.diagnose.least_squares_scorer import mistaken_for
from gcs_autotune.effects import EFFECTS, EffectInstance, ExtendedModel
from gcs_autotune.errors import UnknownName, UsageError
from gcs_autotune.trial import Channel


def test_a_craft_without_hidden_effects_has_no_cause():
    result = diagnose(towed())
    assert result.verdict == "no-effect"
    assert result.causes == ()
    assert result.extended_model.effects == ()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("slug", "place", "values"),
    [
        ("dead-zone", "N", {"width": 0.15}),
        ("asymmetric-thrust", "N", {"ratio": 0.7}),
        ("gyro-bias", "r", {"bias": 0.03}),
        ("wind-moment", "yaw", {"strength": 0.15, "direction": 1.0}),
    ],
)
def test_a_hidden_effect_is_identified_with_its_parameters_and_held_out_gain(slug, place, values):
    result = diagnose(towed((slug, place, values)))
    assert result.verdict == "effect-found"
    assert [c.effect.slug for c in result.causes] == [slug]
    for name, value in values.items():
        got = result.causes[0].parameters[name]
        assert abs(got.value - value) < max(4.0 * got.std, 0.01 * abs(value))
    assert result.gain is not None
    assert result.gain.ratio < 0.8
    assert result.gain.ci95[0] <= result.gain.ratio <= result.gain.ci95[1]
    assert result.ranking[0].p_value < 1e-6


@pytest.mark.slow
def test_two_causes_that_improve_the_fit_only_together_are_both_identified():
    result = diagnose(towed(("backlash", "N", {"width": 0.3}), ("quadratic-drag", "yaw", {"coefficient": 1.5})))
    assert result.verdict == "effect-found"
    assert {c.effect.slug for c in result.causes} == {"backlash", "quadratic-drag"}


@pytest.mark.slow
def test_a_common_lag_is_reported_with_its_usual_cause_and_the_indistinguishable_ones():
    result = diagnose(towed(("input-delay", "N", {"delay": 0.4})))
    assert result.causes[0].effect.slug == "input-delay"
    assert {"input-delay", "time-offset"} <= set(result.indistinguishable[0])
    assert result.next_manoeuvre


@pytest.mark.slow
def test_an_unknown_force_is_not_a_confident_finding():
    runs = []
    for run in towed(noise=0.002):
        t = run["psi"].t
        extra = 0.25 * np.sin(0.9 * t) * np.sign(np.sin(0.31 * t))  # a motion of something else aboard
        r = Channel("r", "rad/s", t, run["r"].values + extra)
        runs.append(replace(run, channels={**run.channels, "r": r}))
    assert diagnose(runs).verdict in ("unexplained", "partly-explained")


@pytest.mark.slow
def test_a_supplied_model_is_judged_unchanged_and_its_wrong_number_is_reported():
    plain = diagnose(towed()).extended_model
    wrong = ExtendedModel(plain.base.with_values({"N_r": 1.3 * plain.base["N_r"]}))
    result = diagnose(towed(("dead-zone", "N", {"width": 0.15}), seed=2), model=wrong)
    assert [c.effect.slug for c in result.causes] == ["dead-zone"]
    assert result.verdict == "wrong-numbers-and-effect"
    assert [n.name for n in result.wrong_numbers] == ["N_r"]
    again = diagnose(towed(("dead-zone", "N", {"width": 0.15}), seed=3), model=result.extended_model)
    assert again.verdict == "no-effect"


@pytest.mark.slow
def test_a_foreign_simulation_of_the_same_commands_is_diagnosed():
    runs = towed(("dead-zone", "N", {"width": 0.15}))
    theirs = [replace(s, name=f"sim{k}") for k, s in enumerate(towed(noise=0.0))]
    result = diagnose(runs, simulations=theirs)
    assert [c.effect.slug for c in result.causes] == ["dead-zone"]
    assert any(d.slug == "simulation-off" for d in result.doubts)
    with pytest.raises(UsageError, match="one simulation per run"):
        diagnose(runs, simulations=theirs[:1])


@pytest.mark.slow
def test_the_document_is_complete_and_its_model_can_be_read_again():
    result = diagnose(
        towed(("dead-zone", "N", {"width": 0.15})), unseen=towed(("dead-zone", "N", {"width": 0.15}), seed=4)
    )
    data = json.loads(result.to_json())
    assert data["verdict"] == "effect-found"
    assert data["causes"] == ["dead-zone"]
    assert set(data["ranking"][0]["parameters"]["width"]) == {"value", "unit", "std"}
    assert set(data["gain"]) >= {"metric", "signal", "before", "after", "ratio", "ci95"}
    assert data["gain"]["metric"] == "held-out simulation RMSE"
    assert ExtendedModel.from_dict(data["extended_model"]).to_dict() == result.extended_model.to_dict()
    assert data["held_out"] == ["run0", "run1"]


def test_only_the_requested_effects_are_tried_and_unknown_ones_are_rejected():
    result = diagnose(towed(("dead-zone", "N", {"width": 0.15})), effects=["quadratic-drag", "input-bias"])
    assert {r.cause for r in result.ranking} <= {"quadratic-drag", "input-bias"}
    assert result.verdict != "effect-found"
    with pytest.raises(UnknownName, match="dead-zone"):
        diagnose(towed(), effects=["dead-zoone"])


@pytest.mark.parametrize("slug", EFFECTS)
def test_every_catalogue_entry_has_a_meaning_and_a_way_to_separate_it(slug):
    entry = EFFECTS[slug]
    assert entry.slug == slug
    assert entry.meaning
    assert entry.shown_by
    assert entry.separated_by
    assert set(entry.mistaken_for) <= set(EFFECTS)
    assert set(entry.yields_to) <= set(EFFECTS)


def test_effects_easily_mistaken_for_a_promising_cause_are_also_fitted():
    def candidate(slug, place):
        return EffectCandidate(EffectInstance(slug, place, {}), None, 0.0, np.zeros(0))

    passed_over = [candidate(*c) for c in (("rudder-stall", "N"), ("rudder-stall", "delta"), ("dead-zone", "N"))]
    taken = mistaken_for(EffectInstance("saturation", "N", {"limit": 1.0}), passed_over)
    assert [(c.effect.slug, c.effect.place) for c in taken] == [("rudder-stall", "N")]
