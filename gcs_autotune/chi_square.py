"""The chi-square distribution from two special functions, since scipy.stats takes seconds to import."""

from __future__ import annotations

from scipy.special import chdtrc, chdtri

__all__ = ["exceeded_by_chance", "quantile", "threshold"]


def exceeded_by_chance(statistic: float, freedom: float) -> float:
    """Return the probability that a chi-square of *freedom* degrees exceeds *statistic*."""
    return float(chdtrc(freedom, statistic))


def threshold(probability: float, freedom: float) -> float:
    """Return the value that a chi-square of *freedom* degrees exceeds with *probability*."""
    return float(chdtri(freedom, probability))


def quantile(probability: float, freedom: float) -> float:
    """Return the value that a chi-square of *freedom* degrees stays below with *probability*."""
    return threshold(1.0 - probability, freedom)
