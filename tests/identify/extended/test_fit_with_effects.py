"""Identification with effects: hidden effects are identified with correct standard errors."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from towed_boats import DRAG, INERTIA, NOISE, yaw_run

from gcs_autotune.effects import ExtendedModel
from gcs_autotune.errors import BadFile, UnknownName, UsageError
from gcs_autotune.identify import Fit, doubts, fit, load_model, save_model, validate

HIDDEN = {"dead-zone@N": {"width": 0.2}, "input-bias@yaw": {"bias": 0.1}}
TRUTH = {"N_rdot": -INERTIA, "N_r": -DRAG, "dead-zone@N.width": 0.2, "input-bias@yaw.bias": 0.1}


@pytest.fixture(scope="module")
def found() -> Fit:
    return fit([yaw_run(1, HIDDEN), yaw_run(2, HIDDEN)], effects=["dead-zone", "input-bias"])


def test_hidden_effects_are_identified_within_four_standard_errors(found: Fit) -> None:
    for name, true in TRUTH.items():
        p = found.parameters[name]
        assert p.status == "fitted" and p.std > 0.0
        assert abs(p.value - true) < 4.0 * p.std, (name, p)
        assert p.std < 0.02 * abs(true)


def test_standard_errors_respect_the_cramer_rao_bound_and_noise_is_identified(found: Fit) -> None:
    for name in TRUTH:
        assert found.parameters[name].std >= found.parameters[name].bound > 0.0
    for signal, level in NOISE.items():
        assert found.noise[signal] == pytest.approx(level, rel=0.06)


def test_standard_errors_match_the_scatter_over_repetitions(found: Fit) -> None:
    z = []
    for seed in range(10, 22):
        one = fit(yaw_run(seed, HIDDEN, duration=30.0), start=found.model)
        z += [(one.parameters[n].value - true) / one.parameters[n].std for n, true in TRUTH.items()]
    assert 0.7 < float(np.sqrt(np.mean(np.square(z)))) < 1.4  # 48 values


def test_covariance_traces_and_doubts_are_those_of_any_fit(found: Fit) -> None:
    assert found.covariance.shape == (4, 4)
    assert {(t.run, t.signal) for t in found.traces} == {(f"run{i}", s) for i in (1, 2) for s in ("psi", "r")}
    inside = np.concatenate([np.abs(t.measured - t.fitted) < t.band for t in found.traces])
    assert 0.93 < inside.mean() < 0.97
    assert found.doubts == ()
    assert found.parameters["dead-zone@N.width"].unit == "N m"


def test_held_out_prediction_is_as_good_as_the_noise_allows(found: Fit) -> None:
    checked = validate(found.model, yaw_run(7, HIDDEN))
    for statistics, trace in zip(checked.statistics, checked.traces, strict=True):
        assert statistics.rms < 1.1 * NOISE[trace.signal]
    plain = validate(fit(yaw_run(1, HIDDEN), effects=["input-bias"]).model, yaw_run(7, HIDDEN))
    assert checked.fit_percent > plain.fit_percent + 5.0


def test_an_absent_effect_is_reported_as_not_needed() -> None:
    found = fit([yaw_run(1, {})], effects=["dead-zone"])
    assert "effect-not-needed" in {d.slug for d in found.doubts}
    assert abs(found.parameters["dead-zone@N.width"].value) < 0.01


def test_a_doubt_names_the_parameter_of_an_effect_in_words(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(doubts, "TOGETHER", 0.01)
    correlated = next(d for d in fit(yaw_run(1, HIDDEN), effects=["dead-zone"]).doubts if d.slug == "correlated")
    assert "width of the dead zone (N)" in correlated.cause and "@" not in correlated.cause


def test_a_saved_model_is_the_start_of_the_next_fit(found: Fit, tmp_path: Path) -> None:
    save_model(found, tmp_path / "model.json")
    file = load_model(tmp_path / "model.json")
    assert file.model == found.model
    assert file.inputs == {"N": "N m"}
    np.testing.assert_allclose(file.covariance, found.covariance, rtol=1e-9)
    off = replace(
        file.model, effects=tuple(e.with_values({n: 0.7 * v for n, v in e.values.items()}) for e in file.model.effects)
    )
    again = fit([yaw_run(1, HIDDEN), yaw_run(2, HIDDEN)], start=off)
    for name in TRUTH:
        assert again.parameters[name].value == pytest.approx(
            found.parameters[name].value, abs=0.05 * found.parameters[name].std
        )


def test_effects_can_be_added_to_a_starting_model() -> None:
    first = fit(yaw_run(1, HIDDEN), effects=["dead-zone@N"])
    assert isinstance(first.model, ExtendedModel)
    second = fit(yaw_run(1, HIDDEN), start=first.model, effects=["input-bias"])
    assert {e.slug for e in second.model.effects} == {"dead-zone", "input-bias"}  # type: ignore[attr-defined]
    assert (
        abs(second.parameters["input-bias@yaw.bias"].value - 0.1) < 4.0 * second.parameters["input-bias@yaw.bias"].std
    )


def test_a_model_of_one_axis_can_be_the_start(tmp_path: Path) -> None:
    axis = fit([yaw_run(1, {}), yaw_run(2, {})], "affine", dof="yaw", delay=0.0)
    save_model(axis, tmp_path / "axis.json")
    file = load_model(tmp_path / "axis.json")
    assert file.axis == axis.model
    again = fit([yaw_run(1, {}), yaw_run(2, {})], start=file.model)
    assert -again.parameters["N_rdot"].value == pytest.approx(axis.model.alpha, rel=0.01)


def test_invalid_effects_and_models_are_rejected_with_a_reason(tmp_path: Path) -> None:
    run = yaw_run(1, {})
    with pytest.raises(UnknownName, match="dead-zone"):
        fit(run, effects=["deadzone"])
    with pytest.raises(UsageError, match="cannot act on 'surge'"):
        fit(run, effects=["input-bias@surge"])
    with pytest.raises(UsageError, match="output-error"):
        fit(run, method="ekf", effects=["dead-zone"])
    (tmp_path / "bad.json").write_text('{"model": 3}', encoding="utf-8")
    with pytest.raises(BadFile, match="contains no model"):
        load_model(tmp_path / "bad.json")
