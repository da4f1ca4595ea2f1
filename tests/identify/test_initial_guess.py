"""Searches have a start for everything that no regression on the equations of motion can see."""

from __future__ import annotations

import math

from gcs_autotune.identify.problems.initial_guess import SPECIAL_START
from gcs_autotune.models import SPECIAL


def test_every_special_parameter_has_a_finite_start_and_room_to_move() -> None:
    assert set(SPECIAL_START) == set(SPECIAL)
    assert all(math.isfinite(s.value) and 0.0 < s.spread < math.inf for s in SPECIAL_START.values())


def test_the_reach_of_the_bottom_begins_where_it_can_be_computed() -> None:
    assert SPECIAL_START["reach"].value > 0.0
