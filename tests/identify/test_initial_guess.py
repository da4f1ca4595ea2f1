"""Searches have a start for every parameter outside the regression on the equations of motion."""

from __future__ import annotations

import math

from gcs_autotune.identify.problems.initial_guess import SPECIAL_START
from gcs_autotune.models import SPECIAL


def test_every_special_parameter_has_a_finite_start_and_spread() -> None:
    assert set(SPECIAL_START) == set(SPECIAL)
    assert all(math.isfinite(s.value) and 0.0 < s.spread < math.inf for s in SPECIAL_START.values())


def test_the_start_of_the_bottom_reach_is_positive() -> None:
    assert SPECIAL_START["reach"].value > 0.0
