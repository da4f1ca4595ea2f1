"""Coloured residuals, by number: whiteness, correlation time, and the covariance of correlated scores."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import stats
from scipy.signal import lfilter

from gcs_autotune.identify.signals import autocorrelation, correlation_time
from gcs_autotune.identify.signals.whiteness import SIGNIFICANCE, all_white, scores_covariance, whiteness


def white(seed: int, n: int = 400) -> np.ndarray:
    return np.random.default_rng(seed).normal(size=n)


def first_order(seed: int, rho: float, n: int) -> np.ndarray:
    """Noise of unit innovations whose autocorrelation at lag k is ``rho**k``."""
    return np.asarray(lfilter([1.0], [1.0, -rho], white(seed, n)))


def test_the_autocorrelation_is_that_of_the_definition() -> None:
    assert autocorrelation(np.array([1.0, 2.0, 4.0, 1.0]), 2) == pytest.approx([-1.0 / 3.0, -1.0 / 3.0])
    assert autocorrelation(np.full(9, 3.0), 4).tolist() == [0.0] * 4


@pytest.mark.parametrize("n", [20, 400])
def test_whiteness_is_the_ljung_box_test_of_ten_lags_or_a_quarter_of_the_samples(n: int) -> None:
    errors, lags = white(3, n), min(10, n // 4)
    free = errors - errors.mean()
    rho = [float(free[k:] @ free[: n - k]) / float(free @ free) for k in range(1, lags + 1)]
    statistic = n * (n + 2) * sum(r**2 / (n - k) for k, r in enumerate(rho, start=1))
    assert whiteness(errors) == pytest.approx(float(stats.chi2.sf(statistic, lags)))


def test_more_series_require_more_evidence_to_call_one_coloured() -> None:
    """A series that alone would be called coloured, at 0.2 to 0.8 of the level, is luck among five."""
    chosen = next(w for w in map(white, range(2000)) if 0.2 < whiteness(w) / SIGNIFICANCE < 0.8)
    others = [w for w in map(white, range(2000, 2010)) if whiteness(w) > 0.5][:4]
    assert len(others) == 4
    assert not all_white([chosen])
    assert all_white([chosen, *others])
    assert not all_white([*others, first_order(1, 0.9, 400)])


@pytest.mark.parametrize("rho", [0.5, 0.8])
def test_the_correlation_time_is_the_samples_per_independent_one(rho: float) -> None:
    series = [first_order(seed, rho, 5000) for seed in range(3)]
    assert correlation_time(series) == pytest.approx((1.0 + rho) / (1.0 - rho), rel=0.2)


def test_white_and_alternating_residuals_have_correlation_time_one() -> None:
    assert correlation_time([white(5), white(6)]) == 1.0
    assert correlation_time([first_order(1, -0.8, 2000)]) == 1.0


def test_the_correlation_time_is_limited_to_a_twentieth_of_the_samples() -> None:
    assert correlation_time([np.cumsum(np.ones(400))]) == pytest.approx(20.0)


def test_the_covariance_of_scores_is_that_of_newey_and_west() -> None:
    """By hand: three samples, weights 1, 2/3 and 1/3."""
    own = np.array([[1.0, 0.0], [2.0, 1.0], [3.0, -1.0]])
    zero = own.T @ own
    first = np.outer(own[1], own[0]) + np.outer(own[2], own[1])
    second = np.outer(own[2], own[0])
    expected = zero + 2.0 / 3.0 * (first + first.T) + 1.0 / 3.0 * (second + second.T)
    assert scores_covariance([own]) == pytest.approx(expected)
    assert scores_covariance([own, 2.0 * own]) == pytest.approx(5.0 * expected)


@pytest.mark.parametrize("rho", [0.7, -0.5])
def test_the_sum_of_coloured_scores_has_the_predicted_variance(rho: float) -> None:
    """Its variance per sample is ``(1 - rho)**-2``: more than that of white ones or less, as the colour has it."""
    n = 20_000
    found = scores_covariance([first_order(2, rho, n)[:, None]])[0, 0] / n
    assert math.sqrt(found) == pytest.approx(1.0 / (1.0 - rho), rel=0.1)


@pytest.mark.parametrize(("n", "reach"), [(100, 20), (101, 21), (4, 3), (2, 1)])
def test_the_covariance_of_scores_uses_two_root_n_lags_with_bartlett_weights(n: int, reach: int) -> None:
    scores = np.random.default_rng(n).normal(size=(n, 2))
    expected = scores.T @ scores
    for k in range(1, reach + 1):
        lagged = scores[k:].T @ scores[:-k]
        expected += (1.0 - k / (reach + 1.0)) * (lagged + lagged.T)
    assert scores_covariance([scores]) == pytest.approx(expected)
    assert scores_covariance([scores, scores]) == pytest.approx(2.0 * expected), "runs are added, not joined"
