"""Least squares, its bias, instrumental variables against it, and the recursive form."""

from __future__ import annotations

import numpy as np
import pytest
from regression_plants import TRUTH, M, camera_run, coupled, velocity_run, yaw_run

from gcs_autotune.errors import UnknownName, UsageError
from gcs_autotune.identify import fit
from gcs_autotune.identify.problems import inverse_of
from gcs_autotune.identify.regression import drives_of, motion_of
from gcs_autotune.identify.signals import prepare_form
from gcs_autotune.models import Form
from gcs_autotune.trial import Channel, Trial

RUNS = ((2.0, 0.06), (1.5, 0.09))


def runs(noise: float, seed: int = 0) -> list:
    return [velocity_run(10 * seed + i, X, N, noise) for i, (X, N) in enumerate(RUNS)]


def far(found, names=TRUTH) -> dict[str, float]:
    return {n: found.parameters[n].value / TRUTH[n] - 1.0 for n in names}


@pytest.mark.parametrize("equation", ["integral", "derivative"])
def test_parameters_are_identified_without_noise(equation):
    found = fit(runs(0.0), coupled(), "least-squares", equation=equation)
    assert max(abs(e) for e in far(found).values()) < (0.01 if equation == "integral" else 0.2)
    if equation == "integral":
        assert found.fit_percent > 99.0


def test_windows_beat_accelerations_on_noisy_positions():
    trials = [camera_run(i, X, N, duration=24.0) for i, (X, N) in enumerate(RUNS)]
    worst = {
        equation: max(abs(e) for e in far(fit(trials, coupled(), "least-squares", equation=equation)).values())
        for equation in ("integral", "derivative")
    }
    assert worst["integral"] < 0.03
    assert worst["integral"] < 0.3 * worst["derivative"]


@pytest.mark.slow
def test_noise_biases_least_squares_and_instrumental_variables_remove_the_bias():
    shares = {"least-squares": [], "instrumental-variables": []}
    errors = {"least-squares": [], "instrumental-variables": []}
    for seed in range(3):
        trials = runs(0.03, seed)
        for method in shares:
            found = fit(trials, coupled(), method, equation="derivative")
            errors[method].append(far(found)["X_udot"])
            shares[method].append(errors[method][-1] * abs(TRUTH["X_udot"]) / found.parameters["X_udot"].std)
    biased = np.array(errors["least-squares"])
    assert abs(biased.mean()) > 0.05
    assert abs(biased.mean()) > 5.0 * biased.std() / np.sqrt(len(biased))
    assert abs(np.mean(errors["instrumental-variables"])) < 0.25 * abs(biased.mean())
    assert abs(np.mean(shares["instrumental-variables"])) < 2.5 / np.sqrt(len(biased))


def test_the_noise_bias_is_reported_with_its_size():
    found = fit(runs(0.03), coupled(), "least-squares", equation="derivative")
    assert "noise-bias" in [d.slug for d in found.doubts]
    error = found.parameters["X_udot"].value - TRUTH["X_udot"]
    assert found.extra["noise_bias"]["X_udot"] == pytest.approx(error, rel=0.5)


@pytest.mark.slow
def test_standard_errors_of_instrumental_variables_cover_the_truth():
    """Small version of benchmarks/regression_bias.py."""
    inside = []
    for seed in range(6):
        trial = velocity_run(seed, 2.0, 0.06, 0.02, duration=24.0)
        found = fit(trial, coupled(), "instrumental-variables")
        inside += [abs(found.parameters[n].value - v) < 1.96 * found.parameters[n].std for n, v in TRUTH.items()]
    assert 0.8 < np.mean(inside)


def test_a_constant_term_absorbs_a_constant_force():
    pulled = [
        type(run)(run.name, {**run.channels, "X": type(run["X"])("X", "N", run["X"].t, run["X"].values - 0.4)})
        for run in runs(0.005)
    ]
    found = fit(pulled, coupled(), "least-squares", bias=True)
    assert found.parameters["X_0"].value == pytest.approx(0.4, abs=0.03)
    assert found.parameters["X_u"].value == pytest.approx(TRUTH["X_u"], rel=0.02)


@pytest.mark.slow
def test_outliers_hardly_move_the_robust_fit():
    trials = runs(0.005)
    rng = np.random.default_rng(1)
    values = trials[0]["r"].values
    values[rng.choice(len(values), 8, replace=False)] += 3.0
    plain = far(fit(trials, coupled(), "least-squares"))["N_rdot"]
    robust = far(fit(trials, coupled(), "least-squares", loss="soft_l1"))["N_rdot"]
    assert abs(robust) < 0.5 * abs(plain)


def test_collinear_terms_are_reported():
    with_both = coupled("X_uu")
    steady = [velocity_run(0, 2.0, 0.002, 0.002, duration=20.0)]
    found = fit(steady, with_both, "least-squares")
    factors = found.extra["variance_inflation"]
    assert factors["X_u"] > 20.0
    assert factors["X_u"] == pytest.approx(factors["X_uu"], rel=0.5)
    doubt = [d for d in found.doubts if d.slug == "collinear"]
    assert any("X_u" in d.cause or "X_udot" in d.cause for d in doubt) == (max(factors.values()) > 100.0)


@pytest.mark.slow
def test_recursive_and_batch_least_squares_agree():
    trials = runs(0.01)
    batch = fit(trials, coupled(), "least-squares")
    found = fit(trials, coupled(), "recursive-least-squares")
    for name in TRUTH:
        assert abs(found.parameters[name].value - batch.parameters[name].value) < batch.parameters[name].std
    history = found.extra["history"]
    stds = np.array(history["stds"]["Y_v"])
    assert stds[-1] < 0.5 * stds[0]
    assert len(history["t"]) == len(history["values"]["Y_v"])


@pytest.mark.slow
def test_forgetting_follows_a_craft_that_changes():
    before = yaw_run((8.0, 2.6, 0.0), (0.4, 0.17), step=0.1, noise=0.001, rate_noise=0.002, duration=120.0)
    after = yaw_run((8.0, 5.2, 0.0), (0.4, 0.17), step=0.1, noise=0.001, rate_noise=0.002, duration=120.0)
    kept = fit([before, after], "linear", "recursive-least-squares", dof="yaw")
    fading = fit([before, after], "linear", "recursive-least-squares", dof="yaw", forgetting=30.0)
    assert fading.parameters["beta_r"].value == pytest.approx(5.2, rel=0.05)
    assert kept.parameters["beta_r"].value < 4.8
    assert any(d.slug == "drifting" for d in kept.doubts)


def test_invalid_options_are_rejected():
    trials = runs(0.01)
    with pytest.raises(UnknownName, match="integral"):
        fit(trials, coupled(), "least-squares", equation="integrel")
    with pytest.raises(UnknownName, match="savitzky-golay"):
        fit(trials, coupled(), "least-squares", derivative="savitsky-golay")
    with pytest.raises(UsageError, match="window"):
        fit(trials, coupled(), "least-squares", window=-1.0)
    with pytest.raises(UsageError, match="forgetting"):
        fit(trials, coupled(), "recursive-least-squares", forgetting=0.0)


def test_a_known_parameter_stays_fixed_and_the_others_are_fitted():
    found = fit(runs(0.005), coupled().fixing({"Y_vdot": -M[1]}), "least-squares")
    assert found.parameters["Y_vdot"].status == "fixed"
    assert found.parameters["Y_vdot"].std == 0.0
    assert found.parameters["X_udot"].value == pytest.approx(-M[0], rel=0.01)


def test_the_acceleration_regression_is_the_papers_for_one_axis():
    """(4.20): nu_dot = -beta/alpha nu + tau/alpha + Delta, by the normal equations written out here."""
    run = yaw_run((8.0, 2.6, 0.0), (0.4, 0.17), step=0.1, noise=0.001, rate_noise=0.002, duration=100.0)
    found = fit(run, "linear", "least-squares", dof="yaw", equation="derivative", use=("velocity",))
    form = Form("yaw", "", ("yaw",), ("N_rdot", "N_r", "N_0"), {}, {"N": (("N", 1.0),)})
    (record,) = prepare_form(run, form, ("r",))
    motion = motion_of(record, form)
    tau = drives_of(record, form, motion.t, motion.step)[:, 0]
    Phi = np.column_stack([-motion.nu[:, 5], tau, np.ones(len(tau))])[2:-2]
    slope, gain, constant = inverse_of(Phi.T @ Phi) @ Phi.T @ motion.nu_dot[2:-2, 5]
    assert found.parameters["alpha_r"].value == pytest.approx(1.0 / gain, rel=1e-5)
    assert found.parameters["beta_r"].value == pytest.approx(slope / gain, rel=1e-5)
    assert found.parameters["delta"].value == pytest.approx(constant / gain, abs=1e-5)


@pytest.mark.parametrize("method", ["least-squares", "instrumental-variables", "recursive-least-squares"])
def test_an_unknown_delay_yields_a_doubt(method):
    run = yaw_run((0.8, 2.6, 0.0), (0.6, 0.3), step=0.1, noise=0.002, duration=60.0)
    late = Channel("psi", "rad", run["psi"].t + 0.6, run["psi"].values)
    found = fit(Trial("late", {"psi": late, "N": run["N"]}), "linear", method, dof="yaw")
    result = fit(Trial("late", {"psi": late, "N": run["N"]}), "linear", method, dof="yaw", delay=0.6)
    assert "beyond-noise" in [d.slug for d in found.doubts]
    assert not {"beyond-noise", "poor-fit"} & {d.slug for d in result.doubts}
    assert result.parameters["beta_r"].value == pytest.approx(2.6, rel=0.05)
