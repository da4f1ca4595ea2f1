"""Start values for other methods: near the truth on good runs, sane on bad ones, never an error."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from regression_plants import TRUTH, coupled, velocity_run

from gcs_autotune.identify.coupled.case import CoupledCase
from gcs_autotune.identify.preparation import prepare_form
from gcs_autotune.identify.regression import start_values


def case_of(trial, form, **change) -> CoupledCase:
    return replace(CoupledCase(form, prepare_form(trial, form), None, False, (trial.name,)), **change)


def test_they_are_near_the_truth():
    found = start_values(case_of(velocity_run(0, 2.0, 0.06, 0.01), coupled()))
    assert set(found) == set(TRUTH)
    for name, truth in TRUTH.items():
        assert found[name] == pytest.approx(truth, rel=0.1)


def test_a_delay_to_be_fitted_and_a_start_given_are_respected():
    form = replace(coupled("delay"), start={"Y_v": -3.0})
    found = start_values(case_of(velocity_run(0, 2.0, 0.06, 0.01), form))
    assert found["delay"] == 0.0
    assert found["Y_v"] == -3.0
    assert set(found) == set(form.free)


def test_a_velocity_nobody_measured_leaves_a_rule_of_thumb():
    run = velocity_run(0, 2.0, 0.06, 0.01)
    blind = replace(run, channels={n: c for n, c in run.channels.items() if n != "v"})
    found = start_values(case_of(blind, coupled()))
    assert set(found) == set(TRUTH)
    assert all(np.isfinite(v) and v < 0.0 for v in found.values())


def test_pure_noise_still_gives_sane_signs():
    run = velocity_run(0, 2.0, 0.06, 0.0)
    rng = np.random.default_rng(0)
    noise = {
        n: replace(c, values=rng.normal(size=len(c)) if n in "uvr" or n == "psi" else c.values)
        for n, c in run.channels.items()
    }
    found = start_values(case_of(replace(run, channels=noise), coupled("Y_rdot")))
    assert set(found) == {*TRUTH, "Y_rdot"}
    assert all(found[n] < 0.0 for n in TRUTH)
    assert all(np.isfinite(v) for v in found.values())
