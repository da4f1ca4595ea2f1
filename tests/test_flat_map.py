"""Positions on the globe to metres north and east; velocities over ground to the body."""

from __future__ import annotations

import math

import numpy as np
import pytest

from gcs_autotune.frames import flat, to_body

DEGREE = math.pi / 180.0 * 6_378_137.0


@pytest.mark.parametrize(
    ("origin_lon", "lon", "degrees"), [(179.9, -179.9, 0.2), (-179.9, 179.9, -0.2), (10.0, 10.1, 0.1)]
)
def test_a_track_across_the_date_line_takes_the_short_way(origin_lon: float, lon: float, degrees: float) -> None:
    north, east = flat(60.1, lon, (60.0, origin_lon))
    assert north == pytest.approx(0.1 * DEGREE)
    assert east == pytest.approx(degrees * DEGREE * 0.5)  # cos 60 deg


def test_opposite_longitudes_are_half_a_turn_west() -> None:
    assert flat(0.0, 180.0, (0.0, 0.0))[1] == pytest.approx(-180.0 * DEGREE)
    assert flat(0.0, 190.0, (0.0, 0.0))[1] == pytest.approx(-170.0 * DEGREE)


def test_velocities_over_ground_are_rotated_into_the_body_frame() -> None:
    psi = np.radians([0.0, 90.0, 180.0])
    ahead, starboard = to_body(np.full(3, 2.0), np.full(3, 1.0), psi)
    assert ahead == pytest.approx([2.0, 1.0, -2.0])
    assert starboard == pytest.approx([1.0, -2.0, -1.0])
