"""The study behind ``identify``: what is checked on what, and what is reported."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gcs_autotune.errors import NotInformative, UsageError
from gcs_autotune.identify import METHODS
from gcs_autotune.report import study_document, to_json
from gcs_autotune.trial import Channel, Trial
from gcs_autotune.workflow import StudySettings, study

ALPHA, BETA = 0.04, 0.02


def steps(seed: int, alpha: float = ALPHA, beta: float = BETA, name: str = "") -> Trial:
    """Random steps on alpha r' + beta r = N, exact between samples, with noise on psi and r."""
    rng = np.random.default_rng(seed)
    t, dt = np.arange(0.0, 60.0, 0.1), 0.1
    tau = np.repeat(rng.uniform(-0.06, 0.06, 30), 20)
    psi, r = np.zeros(len(t)), np.zeros(len(t))
    decay = np.exp(-beta / alpha * dt)
    for k in range(len(t) - 1):
        steady = tau[k] / beta
        psi[k + 1] = psi[k] + steady * dt + (r[k] - steady) * alpha / beta * (1.0 - decay)
        r[k + 1] = steady + (r[k] - steady) * decay
    channels = {
        "psi": Channel("psi", "rad", t, psi + rng.normal(0.0, 0.01, len(t))),
        "r": Channel("r", "rad/s", t, r + rng.normal(0.0, 0.01, len(t))),
        "N": Channel("N", "N m", t, tau),
    }
    return Trial(name or f"steps-{seed}", channels)


@pytest.mark.slow
def test_one_run_is_checked_on_its_last_third_and_the_final_fit_uses_all_of_it() -> None:
    found = study([steps(1)], [], StudySettings(), "2026-01-01T00:00:00")
    assert "without its last 30 %" in found.how_unseen
    assert found.answer.unseen is not None
    assert found.answer.unseen.fit_percent > 90.0
    assert all(t.t[0] >= 60.0 * 0.7 - 0.2 for t in found.answer.unseen.traces)
    assert found.fit.traces[0].t[0] == pytest.approx(0.0)


def test_a_run_whose_first_part_determines_no_model_is_not_said_to_have_a_constant_input() -> None:
    t = np.arange(0.0, 60.0, 0.1)
    N = np.where(t < 45.0, 0.04, 0.0)
    r = np.where(t < 45.0, 2.0 * (1.0 - np.exp(-0.5 * t)), 2.0 * np.exp(-0.5 * (t - 45.0)))
    noisy = {"r": ("rad/s", r + np.random.default_rng(1).normal(0.0, 0.01, len(t))), "N": ("N m", N)}
    run = Trial("decay", {n: Channel(n, unit, t, values) for n, (unit, values) in noisy.items()})
    found = study([run], [], StudySettings(structure="linear"), "2026-01-01T00:00:00")
    assert "A second model would need the first 70 % of the run alone, but there the input N" in found.how_unseen


@pytest.mark.slow
def test_held_out_errors_of_the_structures_have_a_unit_and_name_their_data() -> None:
    run = steps(4)
    depth = {
        "z": replace(run["psi"], name="z", unit="m"),
        "w": replace(run["r"], name="w", unit="m/s"),
        "Z": replace(run["N"], name="Z", unit="N"),
    }
    found = study([replace(run, channels=depth)], [], StudySettings(dof="heave"), "2026-01-01T00:00:00")
    assert {row[1].rpartition(" ")[2] for row in found.choice} == {"m"}
    assert "parts of the run held out in turn (depth" in found.choice_verdict


@pytest.mark.slow
def test_each_of_several_runs_is_predicted_from_the_others() -> None:
    found = study([steps(1), steps(2), steps(3)], [], StudySettings(), "2026-01-01T00:00:00")
    assert found.answer.unseen is not None
    reported = [(t.run, t.signal) for t in found.answer.unseen.traces]
    assert reported == [(f"steps-{k}", s) for k in (1, 2, 3) for s in ("psi", "r")]


def test_a_run_of_another_vehicle_is_predicted_badly() -> None:
    other = steps(9, alpha=0.12, beta=0.02, name="other")
    found = study([steps(1), steps(2)], [other], StudySettings(), "2026-01-01T00:00:00")
    assert found.answer.unseen is not None
    assert found.answer.unseen.fit_percent < found.fit.fit_percent - 20.0


@pytest.mark.slow
def test_all_methods_are_compared_and_a_refusing_one_reports_its_reason() -> None:
    found = study([steps(1)], [], StudySettings(structure="linear", method="all", check=False), "2026-01-01T00:00:00")
    names = [o.method for o in found.outcomes]
    assert names[0] == "output-error"
    assert len(names) == len(METHODS)
    refused = {o.method: o.refusal for o in found.outcomes if o.fit is None}
    assert "relay" in refused["iso"]
    data = to_json(study_document(found))
    assert data["methods"]["iso"] == {"refused": refused["iso"]}
    assert data["methods"]["output-error"]["parameters"]["alpha_r"]["value"] == pytest.approx(ALPHA, rel=0.02)


def test_a_single_method_that_refuses_ends_the_study_with_its_reason() -> None:
    with pytest.raises(NotInformative, match="relay"):
        study([steps(1)], [], StudySettings(method="iso"), "2026-01-01T00:00:00")


def test_an_option_that_no_method_has_is_refused_by_name() -> None:
    with pytest.raises(UsageError, match="no option 'sparkle'"):
        study([steps(1)], [], StudySettings(options={"sparkle": 1}), "2026-01-01T00:00:00")
