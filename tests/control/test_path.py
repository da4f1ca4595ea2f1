"""Planning: the path passes its points at their times, and shows its speed and its tightest turn."""

from __future__ import annotations

import math

import pytest

from gcs_autotune.control import TimedPath

SQUARE = ((0.0, 0.0, 1.0, 0.0), (10.0, 0.0, 1.0, 0.5), (10.0, 10.0, 2.0, 1.0))


def test_a_path_passes_its_points_at_their_times_and_starts_and_ends_at_rest() -> None:
    path = TimedPath.through((0.0, 10.0, 25.0), SQUARE)
    for t, place in zip(path.times, SQUARE, strict=True):
        assert path.target(t).position == pytest.approx(place)
    assert path.target(0.0).velocity == path.target(60.0).velocity == (0.0,) * 4
    assert path.target(60.0).position == SQUARE[-1]


def test_velocity_and_acceleration_are_derivatives_of_the_position() -> None:
    path, h = TimedPath.through((0.0, 10.0, 25.0), SQUARE), 1e-4
    for t in (0.5, 7.0, 12.0, 20.0):
        before, now, after = (path.target(t + k * h) for k in (-1, 0, 1))
        for i in range(4):
            assert (after.position[i] - before.position[i]) / (2.0 * h) == pytest.approx(now.velocity[i], abs=1e-6)
            assert (after.velocity[i] - before.velocity[i]) / (2.0 * h) == pytest.approx(now.acceleration[i], abs=1e-6)


def test_the_tightest_turn_of_a_circle_is_its_radius() -> None:
    angles = [k * math.pi / 16 for k in range(17)]
    places = tuple((20.0 * math.sin(a), 20.0 * (1.0 - math.cos(a)), 0.0, a) for a in angles)
    times = tuple(4.0 * k for k in range(17))
    speed = 20.0 * math.pi / 16 / 4.0
    path = TimedPath.through(times, places, starts=(speed, 0.0, 0.0, 0.0), leaves=(-speed, 0.0, 0.0, 0.0))
    rate, at, _ = path.sharpest()
    assert at / rate == pytest.approx(20.0, rel=0.05)
    assert path.fastest()[0] == pytest.approx(speed, rel=0.02)


def test_a_path_with_a_final_velocity_continues_beyond_its_end() -> None:
    path = TimedPath.through((0.0, 10.0), (SQUARE[0], SQUARE[1]), starts=(1.0, 0.0, 0.0, 0.0), leaves=None)
    assert path.target(12.0).position[0] == pytest.approx(12.0)
    assert path.sharpest()[0] == pytest.approx(0.0, abs=1e-9)


def test_a_path_that_goes_back_is_a_sharp_turn() -> None:
    places = ((0.0, 0.0, 0.0, 0.0), (20.0, 0.0, 0.0, 0.0), (0.0, 0.5, 0.0, 0.0))
    assert TimedPath.through((0.0, 20.0, 40.0), places).sharpest()[0] > 1.0
