"""The chi-square distribution against scipy.stats, which takes too long to import for the program itself."""

from __future__ import annotations

import math

import pytest
from scipy.stats import chi2

from gcs_autotune.chi_square import exceeded_by_chance, quantile, threshold


@pytest.mark.parametrize("freedom", [1.0, 2.0, 7.5, 40.0])
@pytest.mark.parametrize("probability", [0.005, 0.05, 0.5, 0.95])
def test_thresholds_and_quantiles_are_those_of_the_distribution(freedom: float, probability: float) -> None:
    assert threshold(probability, freedom) == pytest.approx(chi2.isf(probability, freedom))
    assert quantile(probability, freedom) == pytest.approx(chi2.ppf(probability, freedom))
    assert exceeded_by_chance(threshold(probability, freedom), freedom) == pytest.approx(probability)


def test_the_tail_probability_is_one_at_zero_and_correct_at_four() -> None:
    assert exceeded_by_chance(0.0, 1.0) == 1.0
    assert exceeded_by_chance(4.0, 1.0) == pytest.approx(math.erfc(math.sqrt(2.0)))
    assert exceeded_by_chance(4.0, 2.0) == pytest.approx(math.exp(-2.0))
