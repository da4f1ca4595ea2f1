"""Sensors that round: the likelihood itself, and the fit's statistics on records of a coarse compass."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from axis_plants import DEG, Relay

from gcs_autotune.identify import fit_axis
from gcs_autotune.identify.cramer_rao import cramer_rao
from gcs_autotune.identify.problems.noise import FINEST, Gaussian, Rounded
from gcs_autotune.identify.problems.quick_fit import quanta_of
from gcs_autotune.identify.signals import prepare
from gcs_autotune.models import SingleDof
from gcs_autotune.trial import Channel, Trial

pytestmark = pytest.mark.slow

SEEDS = 40
SIGMA, QUANTUM = 0.25 * DEG, 2.0 * DEG
VIDEORAY = (0.031, 0.0, 0.069, 0.003)
NAMES = ("alpha_r", "beta_rr", "delta")


@pytest.fixture(scope="module")
def clean(record: Callable[..., Trial]) -> list[Trial]:
    return [record(VIDEORAY, Relay(C, 15 * DEG), 25.0, name=str(C)) for C in (0.08, 0.16)]


def coarse(trial: Trial, seed: int, sigma: float = SIGMA, quantum: float = QUANTUM) -> Trial:
    psi = trial["psi"]
    heading = np.unwrap(psi.values) + np.random.default_rng(seed).normal(0.0, sigma, len(psi))
    rounded = quantum * np.round(heading / quantum)
    return Trial(trial.name, {"psi": Channel("psi", "rad", psi.t, rounded), "N": trial["N"]}, meta=trial.meta)


def coarse_runs(clean: list[Trial], seed: int) -> list[Trial]:
    return [coarse(t, 1000 * k + seed) for k, t in enumerate(clean)]


# --- the likelihood -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("sigma", [0.1, 0.3, 1.0])
def test_slope_is_the_derivative_of_the_log_probability(sigma: float) -> None:
    law, error, h = Rounded(sigma, 1.0, 30.0), np.linspace(-2.0, 2.0, 41) + 0.013, 1e-6
    rise = -0.5 * (law.terms(error - h).deviance - law.terms(error + h).deviance)
    assert law.terms(error).slope == pytest.approx(rise / (2.0 * h), rel=1e-4, abs=1e-6)


def test_curvature_is_never_negative_and_far_outliers_have_no_slope() -> None:
    terms = Rounded(0.125, 1.0, 30.0).terms(np.linspace(-40.0, 40.0, 4001))
    assert terms.curvature.min() >= 0.0
    assert np.isfinite(np.concatenate(terms)).all()
    assert np.abs(terms.slope[[0, -1]]).max() == 0.0
    assert np.abs(terms.slope).max() < 6.0 / 0.125


def test_probabilities_of_all_cells_add_up_to_one() -> None:
    law = Rounded(0.4, 1.0, 30.0)
    cells = np.arange(-15, 16) + 0.3
    assert np.exp(-0.5 * law.terms(cells).deviance).sum() == pytest.approx(1.0, abs=1e-9)


def test_expected_information_is_the_variance_of_the_score() -> None:
    rng = np.random.default_rng(0)
    law = Rounded(0.3, 1.0, 30.0)
    for truth in (0.0, 0.2, 0.45):
        measured = np.round(truth + rng.normal(0.0, 0.3, 200_000))
        by_truth = law.information(np.array([-truth]))[0, 0]
        assert np.var(law.terms(measured - truth).slope) == pytest.approx(by_truth, rel=0.03)


def test_information_is_the_square_of_the_score_over_every_cell() -> None:
    law = Rounded(0.4, 1.0, 30.0)
    for truth in (0.0, 0.2, 0.45):
        score = law.terms(np.arange(-6, 7) - truth)
        expected = float(np.exp(-0.5 * score.deviance) @ score.slope**2)
        assert law.information(np.array([-truth]))[0, 0] == pytest.approx(expected, rel=1e-9)


def test_a_fine_rounding_step_has_no_effect() -> None:
    fine, none = Rounded(1.0, 0.05, 30.0), Gaussian(np.hypot(1.0, 0.05 / np.sqrt(12.0)))
    error = np.linspace(-2.5, 2.5, 11)
    assert fine.information(error)[:, 0] == pytest.approx(none.information(error)[:, 0], rel=0.01)
    assert fine.terms(error).slope == pytest.approx(none.terms(error).slope, abs=0.02)


def test_noise_is_estimated_below_the_rounding_step_but_not_below_the_floor() -> None:
    rng = np.random.default_rng(1)
    truth = rng.uniform(-10.0, 10.0, 4000)
    law = Rounded(1.0, 1.0, 20.0)
    noisy = np.round(truth + rng.normal(0.0, 0.2, 4000)) - truth
    assert law.likeliest(noisy, 0.35).sigma == pytest.approx(0.2, rel=0.05)
    silent = np.round(truth) - truth
    assert law.likeliest(silent, 0.3).sigma == pytest.approx(FINEST, rel=0.01)


# --- the fit --------------------------------------------------------------------------------------------------


def test_a_coarse_compass_is_recognised_and_a_fine_one_is_not(clean: list[Trial]) -> None:
    def quanta(quantum: float) -> dict[str, float]:
        return quanta_of(prepare(coarse(clean[0], 1, quantum=quantum), "yaw"))

    assert quanta(QUANTUM) == {"psi": pytest.approx(QUANTUM)}
    assert quanta(0.8 * SIGMA) == {}


def test_the_fit_to_a_coarse_compass_is_unbiased_and_efficient_and_its_intervals_cover(clean: list[Trial]) -> None:
    model = SingleDof("yaw", "N m", *VIDEORAY)
    free = ("alpha", "beta_quadratic", "delta")
    truth, errors, inside, bounds = np.array([0.031, 0.069, 0.003]), [], [], []
    for seed in range(SEEDS):
        runs = coarse_runs(clean, seed)
        fit = fit_axis(runs, structure="nonlinear", delay=0.0)
        value, std = (np.array([getattr(fit.parameters[n], k) for n in NAMES]) for k in ("value", "std"))
        errors.append(value - truth)
        inside.append(np.abs(value - truth) <= 1.96 * std)
        bounds.append(list(cramer_rao(model, runs, SIGMA, free, QUANTUM).values()))
    table = np.array(errors)
    spread, rms = table.std(axis=0, ddof=1), np.sqrt((table**2).mean(axis=0))
    bound = np.sqrt(np.mean(np.square(bounds), axis=0))
    assert np.all(np.abs(table.mean(axis=0)) < 2.6 * spread / np.sqrt(SEEDS))
    assert np.all(rms < 1.3 * bound)
    assert np.all(rms > 0.75 * bound)
    assert 0.88 <= np.mean(inside) <= 0.99


def test_structure_and_no_delay_are_decided_from_the_coarse_record(clean: list[Trial]) -> None:
    fit = fit_axis(coarse_runs(clean, 3))
    assert fit.structure == "nonlinear"
    assert fit.model.delay == 0.0
    assert fit.extra["quantum"]["psi"] == pytest.approx(QUANTUM)
    assert fit.extra["sigma"]["psi"] == pytest.approx(SIGMA, rel=0.25)
    assert fit.noise_std == pytest.approx(np.hypot(SIGMA, QUANTUM / np.sqrt(12.0)), rel=0.05)
    assert fit.residual_rms == pytest.approx(fit.noise_std, rel=0.15)
    assert all(c.log_likelihood < 0.0 for c in fit.candidates)


def spoiled(runs: list[Trial], *places: slice) -> list[Trial]:
    """Return *runs* with the headings at *places* three steps of the compass off."""
    changed = []
    for trial in runs:
        values = trial["psi"].values.copy()
        for place in places:
            values[place] += 3.0 * QUANTUM
        changed.append(Trial(trial.name, {"psi": Channel("psi", "rad", trial["psi"].t, values), "N": trial["N"]}))
    return changed


def test_samples_three_steps_off_do_not_bias_the_fit(clean: list[Trial]) -> None:
    runs = coarse_runs(clean, 5)
    good = fit_axis(runs, structure="nonlinear", delay=0.0)
    bent = fit_axis(spoiled(runs, slice(20, None, 40)), structure="nonlinear", delay=0.0)
    for name in NAMES:
        parameter = good.parameters[name]
        assert abs(bent.parameters[name].value - parameter.value) < 1.5 * parameter.std, name
    assert {d.slug for d in bent.doubts} - {d.slug for d in good.doubts} == {"outliers"}


def test_a_heading_through_south_gives_the_same_fit_as_through_north(record: Callable[..., Trial]) -> None:
    trial = coarse(record(VIDEORAY, Relay(0.08, 15 * DEG), 25.0), 2)
    psi = trial["psi"]
    turned = np.angle(np.exp(1j * (psi.values + np.pi)))
    south = Trial("south", {"psi": Channel("psi", "rad", psi.t, turned), "N": trial["N"]})
    one, other = (fit_axis(t, structure="nonlinear", delay=0.0) for t in (trial, south))
    assert other.extra["quantum"]["psi"] == pytest.approx(QUANTUM)
    assert other.model.alpha == pytest.approx(one.model.alpha, rel=1e-4)


def test_rounding_raises_the_bound_less_than_noise_of_the_same_variance(clean: list[Trial]) -> None:
    model = SingleDof("yaw", "N m", *VIDEORAY)
    runs = coarse_runs(clean, 1)
    free = ("alpha", "beta_quadratic", "delta")
    rounded = cramer_rao(model, runs, SIGMA, free, QUANTUM)
    assert cramer_rao(model, runs, SIGMA, free)["alpha"] < 0.6 * rounded["alpha"]
    as_noise = cramer_rao(model, runs, np.hypot(SIGMA, QUANTUM / np.sqrt(12.0)), free)
    assert 0.6 < rounded["alpha"] / as_noise["alpha"] < 1.0


def test_neighbours_that_are_far_off_together_are_an_error_of_the_model(clean: list[Trial]) -> None:
    runs = spoiled(coarse_runs(clean, 5), slice(20, None, 80), slice(21, None, 80))
    assert "outliers" not in {d.slug for d in fit_axis(runs, structure="nonlinear", delay=0.0).doubts}
