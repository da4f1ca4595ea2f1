"""From runs to a verdict: names, silence, pairs, given models, other people's simulators."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from runs_in_the_tank import towed

from gcs_autotune.diagnose import diagnose
from gcs_autotune.diagnose.candidates import EffectCandidate
from gcs_autotune.diagnose.least_squares_scorer import mistaken_for
from gcs_autotune.effects import EFFECTS, EffectInstance, ExtendedModel
from gcs_autotune.errors import UnknownName, UsageError
from gcs_autotune.trial import Channel


def test_nothing_is_found_where_nothing_is_hidden():
    told = diagnose(towed())
    assert told.verdict == "no-effect"
    assert told.causes == ()
    assert told.extended_model.effects == ()


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
def test_a_hidden_effect_is_named_with_its_numbers_and_its_gain_on_unseen_data(slug, place, values):
    told = diagnose(towed((slug, place, values)))
    assert told.verdict == "effect-found"
    assert [c.effect.slug for c in told.causes] == [slug]
    for name, value in values.items():
        got = told.causes[0].parameters[name]
        assert abs(got.value - value) < max(4.0 * got.std, 0.01 * abs(value))
    assert told.gain is not None
    assert told.gain.ratio < 0.8
    assert told.gain.ci95[0] <= told.gain.ratio <= told.gain.ci95[1]
    assert told.ranking[0].p_value < 1e-6


@pytest.mark.slow
def test_two_causes_that_only_pay_together_are_both_named():
    told = diagnose(towed(("backlash", "N", {"width": 0.3}), ("quadratic-drag", "yaw", {"coefficient": 1.5})))
    assert told.verdict == "effect-found"
    assert {c.effect.slug for c in told.causes} == {"backlash", "quadratic-drag"}


@pytest.mark.slow
def test_a_common_lag_is_named_by_its_usual_cause_with_those_it_cannot_be_told_from():
    told = diagnose(towed(("input-delay", "N", {"delay": 0.4})))
    assert told.causes[0].effect.slug == "input-delay"
    assert {"input-delay", "time-offset"} <= set(told.indistinguishable[0])
    assert told.next_manoeuvre


@pytest.mark.slow
def test_a_force_nobody_knows_is_no_confident_finding():
    runs = []
    for run in towed(noise=0.002):
        t = run["psi"].t
        extra = 0.25 * np.sin(0.9 * t) * np.sign(np.sin(0.31 * t))  # a motion of something else aboard
        r = Channel("r", "rad/s", t, run["r"].values + extra)
        runs.append(replace(run, channels={**run.channels, "r": r}))
    assert diagnose(runs).verdict in ("unexplained", "partly-explained")


@pytest.mark.slow
def test_a_given_model_is_judged_as_it_is_and_its_wrong_number_is_told():
    plain = diagnose(towed()).extended_model
    wrong = ExtendedModel(plain.base.with_values({"N_r": 1.3 * plain.base["N_r"]}))
    told = diagnose(towed(("dead-zone", "N", {"width": 0.15}), seed=2), model=wrong)
    assert [c.effect.slug for c in told.causes] == ["dead-zone"]
    assert told.verdict == "wrong-numbers-and-effect"
    assert [n.name for n in told.wrong_numbers] == ["N_r"]
    again = diagnose(towed(("dead-zone", "N", {"width": 0.15}), seed=3), model=told.extended_model)
    assert again.verdict == "no-effect"


@pytest.mark.slow
def test_somebody_elses_simulation_of_the_same_commands_is_diagnosed():
    runs = towed(("dead-zone", "N", {"width": 0.15}))
    theirs = [replace(s, name=f"sim{k}") for k, s in enumerate(towed(noise=0.0))]
    told = diagnose(runs, simulations=theirs)
    assert [c.effect.slug for c in told.causes] == ["dead-zone"]
    assert any(d.slug == "simulation-off" for d in told.doubts)
    with pytest.raises(UsageError, match="one simulation per run"):
        diagnose(runs, simulations=theirs[:1])


@pytest.mark.slow
def test_the_document_has_what_it_promises_and_the_model_file_reads_back():
    told = diagnose(
        towed(("dead-zone", "N", {"width": 0.15})), unseen=towed(("dead-zone", "N", {"width": 0.15}), seed=4)
    )
    data = json.loads(told.to_json())
    assert data["verdict"] == "effect-found"
    assert data["causes"] == ["dead-zone"]
    assert set(data["ranking"][0]["parameters"]["width"]) == {"value", "unit", "std"}
    assert set(data["gain"]) >= {"metric", "signal", "before", "after", "ratio", "ci95"}
    assert data["gain"]["metric"] == "held-out simulation RMSE"
    assert ExtendedModel.from_dict(data["extended_model"]).to_dict() == told.extended_model.to_dict()
    assert data["held_out"] == ["run0", "run1"]


def test_only_the_effects_asked_for_are_tried_and_others_must_be_in_the_book():
    told = diagnose(towed(("dead-zone", "N", {"width": 0.15})), effects=["quadratic-drag", "input-bias"])
    assert {r.cause for r in told.ranking} <= {"quadratic-drag", "input-bias"}
    assert told.verdict != "effect-found"
    with pytest.raises(UnknownName, match="dead-zone"):
        diagnose(towed(), effects=["dead-zoone"])


@pytest.mark.parametrize("slug", EFFECTS)
def test_every_entry_of_the_book_says_what_it_is_and_what_separates_it(slug):
    entry = EFFECTS[slug]
    assert entry.slug == slug
    assert entry.meaning
    assert entry.shown_by
    assert entry.separated_by
    assert set(entry.mistaken_for) <= set(EFFECTS)
    assert set(entry.yields_to) <= set(EFFECTS)


def test_what_a_promising_cause_is_easily_mistaken_for_is_fitted_too_however_little_it_promised():
    def candidate(slug, place):
        return EffectCandidate(EffectInstance(slug, place, {}), None, 0.0, np.zeros(0))

    passed_over = [candidate(*c) for c in (("rudder-stall", "N"), ("rudder-stall", "delta"), ("dead-zone", "N"))]
    taken = mistaken_for(EffectInstance("saturation", "N", {"limit": 1.0}), passed_over)
    assert [(c.effect.slug, c.effect.place) for c in taken] == [("rudder-stall", "N")]
