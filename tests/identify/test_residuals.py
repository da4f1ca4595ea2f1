"""Residuals of a model, and how much of them is noise; Gaussian noise by its definition, with and without outliers."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.stats import norm

from gcs_autotune.identify import Remainder
from gcs_autotune.identify.problems.noise import Gaussian, Rounded, gaussian_noise
from gcs_autotune.identify.signals import autocorrelation, correlation_time
from gcs_autotune.identify.signals.whiteness import all_white, remainder_of


@pytest.mark.parametrize(
    ("rms", "noise", "unexplained"),
    [(2.0, 0.0, 2.0), (1.0, 0.6, 0.8), (1.0, 0.89, math.sqrt(1.0 - 0.89**2)), (1.0, 0.9, 0.0), (1.0, 1.0, 0.0)],
)
def test_correlated_residuals_are_unexplained_unless_nine_tenths_are_noise(
    rms: float, noise: float, unexplained: float
) -> None:
    assert Remainder(rms, noise).unexplained == pytest.approx(unexplained)


def test_noise_is_estimated_from_sample_to_sample_changes_within_each_run() -> None:
    slow = 0.5 * np.sin(0.01 * np.arange(3000))
    found = remainder_of([slow, 3.0 + slow])
    assert found.rms == pytest.approx(math.sqrt(np.mean(np.concatenate([slow, 3.0 + slow]) ** 2)))
    assert found.noise < 1e-4, "the jump from one run to the next is none of it"
    white = np.random.default_rng(1).normal(0.0, 0.2, 4000)
    both = remainder_of([slow[:1500] + white[:1500], slow + white[1000:]])
    assert both.noise == pytest.approx(0.2, rel=0.05)
    assert both.unexplained == pytest.approx(math.sqrt(np.mean(slow**2)), rel=0.1)
    by_hand = remainder_of([np.array([3.0, 3.0, 3.3, 3.3, 3.0])])
    assert by_hand.noise == pytest.approx(math.sqrt((0.3**2 + 0.3**2 + 0.3**2) / 3.0 / 6.0))


def test_noise_is_at_most_the_residual_and_at_least_the_rounding_error() -> None:
    turns = np.array([1.0, -1.0] * 9)
    assert remainder_of([turns]) == Remainder(1.0, 1.0)
    line = np.linspace(-1.0, 1.0, 50)
    assert remainder_of([line], 0.25).noise == 0.25
    assert remainder_of([line], 9.0).noise == remainder_of([line]).rms
    short = remainder_of([np.array([1.0, 2.0])])
    assert short.noise == short.rms == pytest.approx(math.sqrt(2.5))


def test_samples_that_are_not_numbers_are_left_out_and_empty_residuals_give_nan() -> None:
    assert remainder_of([np.array([1.0, np.nan, -1.0, 1.0, np.inf, -1.0])]) == Remainder(1.0, 1.0)
    for errors in ([], [np.zeros(0)], [np.full(3, np.nan)]):
        found = remainder_of(errors)
        assert math.isnan(found.rms) and math.isnan(found.noise)


def test_constant_residuals_are_not_correlated_and_size_does_not_matter() -> None:
    assert autocorrelation(np.full(9, 3.0), 2).tolist() == [0.0, 0.0]
    e = 1e-4 * np.array([1.0, 2.0, 0.0, -1.0, -2.0])
    assert autocorrelation(e, 2) == pytest.approx([0.4, -0.2])


def test_a_correlation_counts_until_it_first_falls_below_a_twentieth() -> None:
    rng = np.random.default_rng(4)
    slow = np.convolve(rng.normal(size=2003), np.ones(4), "valid")
    assert not all_white([slow])
    rho = autocorrelation(slow, 500)
    first = int(np.flatnonzero(rho < 0.05)[0])
    assert correlation_time([slow]) == pytest.approx(1.0 + 2.0 * rho[:first].sum())
    assert 3.0 < correlation_time([slow]) < 5.0


ERROR = np.array([0.3, -0.1, 0.0, 2.0, -4.0])


def test_the_likelihood_of_gaussian_noise_is_that_of_the_distribution() -> None:
    assert Gaussian(0.7).log_likelihood(ERROR) == pytest.approx(norm.logpdf(ERROR, scale=0.7).sum())
    assert Gaussian(0.7, robust=True).log_likelihood(ERROR) == Gaussian(0.7).log_likelihood(ERROR)
    assert (Gaussian(0.7).quantum, Gaussian(0.7).std, Gaussian(0.7).robust) == (0.0, 0.7, False)
    assert Gaussian(0.7, robust=True).likeliest(ERROR, 0.4) == Gaussian(0.4, robust=True)
    assert Gaussian(0.5).information(ERROR[:2]).tolist() == [[4.0, 0.0, 2.0]] * 2
    assert gaussian_noise({"r": 0.1}, robust=True) == {"r": Gaussian(0.1, robust=True)}
    assert gaussian_noise({"r": 0.1}) == {"r": Gaussian(0.1)}


def test_the_weight_of_an_outlier_falls_with_its_distance_in_double_standard_deviations() -> None:
    plain, robust = Gaussian(0.5).terms(ERROR), Gaussian(0.5, robust=True).terms(ERROR)
    assert plain.curvature.tolist() == [4.0] * 5
    assert plain.slope == pytest.approx(4.0 * ERROR)
    assert plain.deviance == pytest.approx(4.0 * ERROR**2)
    weight = 4.0 / np.sqrt(1.0 + ERROR**2)
    assert robust.curvature == pytest.approx(weight)
    assert robust.slope == pytest.approx(weight * ERROR)
    assert robust.deviance == pytest.approx(weight * ERROR**2)


def test_the_likelihood_of_rounded_noise_is_the_cell_probability_plus_outliers() -> None:
    noise = Rounded(0.3, 0.5, 9.5)
    assert noise.stray == pytest.approx(1e-3 * 0.5 / 10.0)
    assert noise.std == pytest.approx(math.sqrt(0.09 + 0.25 / 12.0))
    assert not noise.robust
    cell = norm.cdf(ERROR + 0.25, scale=0.3) - norm.cdf(ERROR - 0.25, scale=0.3)
    p = 0.999 * cell + noise.stray
    assert noise.terms(ERROR).deviance == pytest.approx(-2.0 * np.log(p))
    assert noise.log_likelihood(ERROR) == pytest.approx(np.log(p).sum())
    h = 1e-6
    slope = -(noise.terms(ERROR + h).deviance - noise.terms(ERROR - h).deviance) / (-4.0 * h)
    assert noise.terms(ERROR).slope == pytest.approx(slope, abs=1e-5)
    narrow = Rounded(0.1, 0.5, 9.5)
    p0 = 0.999 * (
        norm.cdf(np.arange(-4, 5) * 0.5 + 0.25, scale=0.1) - norm.cdf(np.arange(-4, 5) * 0.5 - 0.25, scale=0.1)
    )
    p0 += narrow.stray
    edges = np.arange(-4.5, 5.0) * 0.5 / 0.1
    by_truth = -0.999 * np.diff(norm.pdf(edges)) / 0.1
    assert narrow.information(np.zeros(1))[0, 0] == pytest.approx(np.sum(by_truth**2 / p0), rel=1e-6)
