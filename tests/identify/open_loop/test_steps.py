"""The method step: Miskovic2010, table 4.1, its published numbers, and simulated craft whose truth is known."""

from __future__ import annotations

import math

import numpy as np
import pytest

from gcs_autotune.errors import NotInformative
from gcs_autotune.identify import fit_axis
from gcs_autotune.identify.open_loop.readings import find_holds
from gcs_autotune.identify.open_loop.step_table import (
    lag,
    linear_type_0,
    nonlinear_type_0,
    nonlinear_type_1,
    row_from_table,
    steady,
    time_to,
    unevenness,
    unevenness_doubts,
)
from gcs_autotune.trial import Channel, Trial

LEVELS = (0.0, 0.05, 0.0, -0.05, 0.0, 0.1, -0.1, 0.02)


def held(levels, seconds):
    return lambda t, eta: levels[min(int(t / seconds + 1e-9), len(levels) - 1)]


@pytest.fixture(scope="module")
def automarine(published):
    rows = published["automarine_step_table_7_10"]["rows"]
    return [
        (r, row_from_table(r[0] * 1e-2, r[1], math.copysign(r[2], r[0])))
        for r in rows  # N m, deg/s, deg; the table prints the magnitude of the lag
    ]


def test_table_7_10_follows_from_its_own_readings(automarine):
    assert len(automarine) > 4
    for printed, row in automarine:
        rounding = 0.006 / abs(printed[0]) + 1e-3  # N is rounded: 0.34 must have been 0.3343 for its own row
        assert row.beta * 1e4 == pytest.approx(printed[3], rel=rounding)
        assert row.beta_quadratic * 1e6 == pytest.approx(printed[4], rel=rounding)
        assert row.alpha_nonlinear * 1e4 == pytest.approx(printed[5], rel=rounding + 1e-3)


def test_table_7_10_has_the_printed_means(automarine):
    assert np.mean([row.beta_quadratic for _, row in automarine]) == pytest.approx(22.55e-6, rel=2e-3)
    assert np.mean([row.alpha_nonlinear for _, row in automarine]) == pytest.approx(7.11e-4, rel=5e-3)


def test_table_7_10_has_uneven_parameters_by_sign_and_at_small_inputs(automarine):
    found = unevenness_doubts([row for _, row in automarine], "nonlinear")
    slugs = {d.slug for d in found}
    assert {"uneven-inertia-size+", "uneven-inertia-small", "uneven-drag-small-scatter"} <= slugs
    assert "uneven-inertia-size-" not in slugs  # to negative inputs the inertia does not change with the input


def test_a_constant_parameter_is_not_called_uneven_more_often_than_chance():
    rng = np.random.default_rng(5)
    tau = np.concatenate([-np.linspace(0.3, 5.0, 12), np.linspace(0.3, 5.0, 12)])
    found = [len(unevenness(tau, 1.0 + 0.1 * rng.standard_normal(24), "drag")) for _ in range(200)]
    assert np.mean(found) / 5.0 < 0.08  # five tests at 5 % each


def test_the_integrals_along_a_response_are_table_4_1_from_rest():
    alpha, tau = 0.04, 0.05
    assert lag(alpha, (0.02, 0.0), tau, 0.0) == pytest.approx(alpha / 0.02**2 * tau, rel=1e-12)
    k = steady((0.0, 0.03), tau)
    assert lag(alpha, (0.0, 0.03), tau, 0.0) == pytest.approx(alpha / 0.03 * math.log(2.0), rel=1e-9)
    assert nonlinear_type_1(tau, k, -lag(alpha, (0.0, 0.03), tau, 0.0)) == pytest.approx((alpha, 0.03), rel=1e-9)
    T_N = time_to(alpha, (0.0, 0.03), tau, 0.0, k * math.tanh(1.0))
    assert nonlinear_type_0(tau, k, T_N) == pytest.approx((alpha, 0.03), rel=1e-9)
    T_L = time_to(alpha, (0.02, 0.0), tau, 0.0, tau / 0.02 * (1.0 - math.exp(-1.0)))
    assert linear_type_0(tau, tau / 0.02, T_L) == pytest.approx((alpha, 0.02), rel=1e-9)


@pytest.mark.parametrize(
    ("plant", "structure"),
    [
        pytest.param((0.04, 0.02, 0.0, 0.002), "linear", marks=pytest.mark.slow),
        ((0.04, 0.0, 0.03, 0.002), "nonlinear"),
        pytest.param((0.04, 0.01, 0.02, 0.0), "affine", marks=pytest.mark.slow),
    ],
)
def test_steps_of_a_measured_position_identify_structure_and_parameters(record, plant, structure):
    fit = fit_axis(record(plant, held(LEVELS, 40.0), 320.0, noise=0.005, seed=2), method="step")
    assert fit.structure == structure
    for p, truth in zip(fit.parameters.values(), plant, strict=False):
        assert abs(p.value - truth) <= 4.0 * p.std + 1e-3 * abs(truth), p
    assert fit.fit_percent > 99.9


def test_steps_of_a_measured_velocity_give_the_same(record):
    trial = record((0.04, 0.0, 0.03, 0.002), held(LEVELS, 40.0), 320.0, rate_noise=0.01, seed=3)
    fit = fit_axis(trial.__class__("rate", {n: trial[n] for n in ("r", "N")}), method="step")
    assert fit.structure == "nonlinear"
    assert fit.parameters["alpha_r"].value == pytest.approx(0.04, rel=0.01)
    assert fit.parameters["beta_rr"].value == pytest.approx(0.03, rel=0.01)


@pytest.mark.slow
def test_standard_errors_of_steps_cover_the_truth(record):
    z = []
    for seed in range(12):
        trial = record((0.04, 0.02, 0.0, 0.002), held((0.0, 0.05, -0.05, 0.05), 30.0), 120.0, noise=0.02, seed=seed)
        fit = fit_axis(trial, method="step", structure="linear")
        z += [
            (fit.parameters[n].value - v) / fit.parameters[n].std
            for n, v in (("alpha_r", 0.04), ("beta_r", 0.02), ("delta", 0.002))
        ]
    assert 0.5 < np.std(z) < 1.6
    assert abs(np.mean(z)) < 0.6


def test_a_step_cut_short_is_left_out_and_reported(record):
    def orders(t, eta):
        return 0.0 if t < 20.0 else 0.05 if t < 50.0 else -0.05 if t < 52.0 else 0.08

    fit = fit_axis(record((0.04, 0.02, 0.0, 0.0), orders, 90.0, noise=0.002), method="step", structure="linear")
    assert "not-settled" in {d.slug for d in fit.doubts}
    assert fit.parameters["alpha_r"].value == pytest.approx(0.04, rel=0.01)
    assert fit.parameters["beta_r"].value == pytest.approx(0.02, rel=0.01)


def test_steps_that_never_settle_are_rejected(record):
    with pytest.raises(NotInformative, match="settled"):
        fit_axis(record((0.04, 0.02, 0.0, 0.0), held((0.0, 0.05, -0.05) * 3, 2.0), 18.0, noise=0.002), method="step")


def test_the_standard_error_includes_the_remaining_transient(record):
    fit = fit_axis(record((0.04, 0.02, 0.0, 0.0), held((0.0, 0.05, -0.05), 9.0), 27.0, noise=1e-5), method="step")
    for name, truth in (("alpha_r", 0.04), ("beta_r", 0.02)):
        assert abs(fit.parameters[name].value - truth) < 3.0 * fit.parameters[name].std


def test_a_craft_that_steers_differently_to_each_side_has_a_doubt(record):
    sides = [0.03, -0.03, 0.05, -0.05, 0.07, -0.07, 0.09, -0.09]
    runs = [
        record(
            (0.04, 0.02 if tau > 0.0 else 0.024, 0.0, 0.0),
            held((0.0, tau), 25.0),
            50.0,
            noise=0.002,
            seed=i,
            name=f"{i}",
        )
        for i, tau in enumerate(sides)
    ]
    fit = fit_axis(runs, method="step", structure="linear")
    assert "uneven-drag-sign" in {d.slug for d in fit.doubts}


def test_a_run_without_a_step_is_rejected_with_what_it_needs(record):
    with pytest.raises(NotInformative, match="contains no usable step"):
        fit_axis(record((0.04, 0.02, 0.0, 0.0), lambda t, e: math.sin(t), 40.0), method="step")


def test_a_rudder_ramp_with_noise_is_two_holds():
    t = np.arange(0.0, 40.0, 0.1)
    rudder = np.clip(2.0 * (t - 15.0), 0.0, 10.0) + 0.02 * np.random.default_rng(1).standard_normal(len(t))
    one, other = find_holds(t, rudder, 40.0)
    assert (one.level, other.level) == pytest.approx((0.0, 10.0), abs=0.1)
    assert other.before == pytest.approx(15.0, abs=0.5)
    assert other.start == pytest.approx(20.0, abs=0.5)


def coasting(seed: int, alpha: float = 0.63, drag: float = 1.146, delta: float = 0.0077) -> Trial:
    """Ten seconds at each of six levels, already turning at first; with no input quadratic drag never lets it rest."""
    levels, rng = (0.0, 0.67, 0.34, 0.0, -0.67, -0.34), np.random.default_rng(seed)
    t = np.arange(0.0, 61.5, 0.1)
    tau = np.array(
        [levels[int(max(s - 1.5 + 1e-9, 0.0) // 10.0) + (s >= 1.5 - 1e-9)] if s < 51.4 else -0.34 for s in t]
    )
    nu, psi, turned = -0.14, 0.0, []
    for force in tau:
        turned.append(psi)
        for _ in range(20):
            nu += 0.005 * (force + delta - drag * abs(nu) * nu) / alpha
            psi += 0.005 * nu
    psi_measured = np.array(turned) + rng.normal(0.0, 0.0044, len(t))
    return Trial("steps", {"N": Channel("N", "1", t, tau), "psi": Channel("psi", "rad", t, psi_measured)})


@pytest.mark.slow
def test_steps_to_neutral_under_quadratic_drag_do_not_bias_the_inertia():
    errors = []
    for seed in range(3):
        fit = fit_axis(coasting(seed), dof="yaw", method="step", structure="nonlinear")
        inertia = fit.parameters["alpha_r"]
        assert "steps-disagree" not in {d.slug for d in fit.doubts}
        assert abs(inertia.value - 0.63) < 3.5 * inertia.std
        errors.append(inertia.value / 0.63 - 1.0)
    assert abs(np.mean(errors)) < 0.01


def test_a_first_hold_that_has_not_settled_is_left_out():
    fit = fit_axis(coasting(1), dof="yaw", method="step", structure="nonlinear")
    (doubt,) = [d for d in fit.doubts if d.slug == "not-settled"]
    assert doubt.cause.startswith("left out: 1 of 6 steps, not settled")
