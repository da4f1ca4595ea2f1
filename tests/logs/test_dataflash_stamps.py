"""Damaged stamps in an onboard log: detected by their neighbours on both sides."""

from __future__ import annotations

import math

import numpy as np
import pytest

from gcs_autotune.logs.dataflash import strays_of

T = 100.0 + 0.1 * np.arange(40)


@pytest.mark.parametrize("off", [2.5, -2.5, 1e6, -1e6, math.nan, math.inf])
@pytest.mark.parametrize("place", [5, 20, 34])
def test_a_stamp_far_from_the_neighbours_on_both_sides_is_a_stray(off: float, place: int) -> None:
    t = T.copy()
    t[place] += off
    assert np.flatnonzero(strays_of(t)).tolist() == [place]


@pytest.mark.parametrize("off", [1.6, -1.6, 0.0])
def test_stamps_within_two_seconds_of_neighbours_are_not_strays(off: float) -> None:
    t = T.copy()
    t[20] += off
    assert not strays_of(t).any()


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize(("off", "is_stray"), [(2.375, False), (2.5, True)])
def test_exactly_two_seconds_from_the_nearer_neighbours_is_not_a_stray(side: float, off: float, is_stray: bool) -> None:
    """The middle one of the five before, and after, is three eighths of a second away."""
    t = 0.125 * np.arange(40)
    t[20] += side * off
    assert strays_of(t).any() == is_stray


@pytest.mark.parametrize(("off", "is_stray"), [(2.0, False), (2.125, True), (-2.0, False), (-2.125, True)])
def test_a_stamp_among_equal_ones_is_a_stray_beyond_two_seconds(off: float, is_stray: bool) -> None:
    t = np.full(40, 50.0)
    t[20] += off
    t[30:] = 60.0
    assert np.flatnonzero(strays_of(t)).tolist() == [20] * is_stray


@pytest.mark.parametrize("gap", [50.0, -50.0])
def test_a_log_that_paused_or_restarted_has_no_strays(gap: float) -> None:
    """Every stamp fits its neighbours on one side."""
    t = np.concatenate([T, T + gap])
    assert not strays_of(t).any()


@pytest.mark.parametrize(("off", "is_stray"), [(500.0, False), (-500.0, False), (700.0, True), (-700.0, True)])
@pytest.mark.parametrize("place", [0, 4, 35, 39])
def test_at_the_ends_only_a_stamp_ten_minutes_away_is_a_stray(off: float, is_stray: bool, place: int) -> None:
    t = T.copy()
    t[place] += off
    assert np.flatnonzero(strays_of(t)).tolist() == ([place] if is_stray else [])
    assert len(strays_of(t)) == len(t)
