"""Input stamps midway between two messages: a constant shift is a nuisance, not inertia and not a delay."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np
import pytest
from axis_plants import DEG, Relay

from gcs_autotune.identify import fit_axis
from gcs_autotune.identify.cramer_rao import cramer_rao
from gcs_autotune.identify.signals import prepare
from gcs_autotune.models import SingleDof
from gcs_autotune.trial import Channel, Trial

QUICK = (0.031, 0.0, 0.069, 0.003)
NOISE = 0.004
STEP = 0.02


@pytest.fixture(scope="module")
def clean(record: Callable[..., Trial]) -> list[Trial]:
    return [record(QUICK, Relay(C, 15 * DEG), 30.0, dt=STEP, name=str(C)) for C in (0.08, 0.16)]


def dated_midway(trial: Trial, seed: int) -> Trial:
    """Outputs heard every step, changes dated half a step too early; heading at a fifth of that rate."""
    rng = np.random.default_rng(seed)
    N, psi = trial["N"], trial["psi"]
    changed = np.concatenate([[False], np.diff(N.values) != 0.0])
    heading = Channel("psi", "rad", psi.t[::5], psi.values[::5] + rng.normal(0.0, NOISE, len(psi.t[::5])))
    early = dataclasses.replace(N, t=N.t - np.where(changed, 0.5 * STEP, 0.0))
    return Trial(trial.name, {"psi": heading, "N": early}, meta={"outputs_dated": "midway"})


def test_the_record_states_how_far_a_jump_may_be_from_its_stamp(clean: list[Trial]) -> None:
    trial = dated_midway(clean[0], 1)
    assert prepare(trial, "yaw")[0].dating == pytest.approx(0.5 * STEP)
    assert prepare(dataclasses.replace(trial, meta={}), "yaw")[0].dating == 0.0


def test_early_stamps_bias_the_inertia_only_if_taken_as_exact(clean: list[Trial]) -> None:
    runs = [dated_midway(t, k) for k, t in enumerate(clean)]
    believed = [dataclasses.replace(t, meta={}) for t in runs]
    honest = fit_axis(runs, structure="nonlinear")
    deceived = fit_axis(believed, structure="nonlinear", delay=0.0)
    alpha, wrong = honest.parameters["alpha_r"], deceived.parameters["alpha_r"]
    assert abs(alpha.value - 0.031) < 2.5 * alpha.std
    assert abs(wrong.value - 0.031) > 5.0 * wrong.std
    assert honest.extra["time_shift"] == pytest.approx(0.5 * STEP, abs=0.003)


def test_the_shift_is_not_a_delay_of_the_craft(clean: list[Trial]) -> None:
    fit = fit_axis([dated_midway(t, 7) for t in clean])
    assert fit.model.delay == 0.0
    assert fit.parameters["delay"].status == "absent"
    assert fit.parameters["delay"].std == 0.0
    assert "delay-fitted" not in {d.slug for d in fit.doubts}


def test_a_delay_beyond_what_the_stamps_allow_is_identified(record: Callable[..., Trial]) -> None:
    trials = [record(QUICK, Relay(C, 15 * DEG), 30.0, dt=STEP, delay=0.2, name=str(C)) for C in (0.08, 0.16)]
    fit = fit_axis([dated_midway(t, 3) for t in trials], structure="nonlinear")
    assert fit.model.delay == pytest.approx(0.2 + 0.5 * STEP, abs=0.01)
    assert fit.parameters["delay"].status == "fitted"


def test_the_bound_includes_the_uncertainty_of_the_stamps(clean: list[Trial]) -> None:
    model, free = SingleDof("yaw", "N m", *QUICK), ("alpha", "beta_quadratic", "delta")
    runs = [dated_midway(t, 2) for t in clean]
    shifted = cramer_rao(model, runs, NOISE, free)
    exact = cramer_rao(model, [dataclasses.replace(t, meta={}) for t in runs], NOISE, free)
    assert shifted["alpha"] > 1.5 * exact["alpha"]
    fit = fit_axis(runs, structure="nonlinear")
    assert fit.parameters["alpha_r"].std == pytest.approx(shifted["alpha"], rel=0.1)


@pytest.mark.parametrize("rate", [2.0, 3.0, 4.0, 10.0])
def test_output_changes_reported_over_a_slow_link_keep_their_uncertainty(rate: float) -> None:
    t = np.arange(0.0, 40.0, 1.0 / rate)
    N = Channel("N", "1", t, np.where(np.arange(len(t)) // 5 % 2, 0.3, -0.3))
    psi = Channel("psi", "rad", t, np.sin(0.5 * t))
    meta = {"outputs_dated": "midway", "loop_period": STEP}
    (segment,) = prepare(Trial("slow", {"psi": psi, "N": N}, meta=meta), "yaw")
    assert segment.slack[1:] == pytest.approx(1.0 / rate - STEP, abs=0.5 * STEP)
