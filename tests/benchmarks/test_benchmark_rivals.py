"""The oracle of the rivals' contest, on a craft of arithmetic."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
import pytest

from benchmarks.rivals.fleet import FLEET
from benchmarks.rivals.oracle import search
from benchmarks.rivals.rehearsal import true_hull
from gcs_autotune.design import StepMetrics

RANGES = {"P": (0.0, 2.0), "A": (1.0, 10.0)}


def fly(gains: Mapping[str, float]) -> StepMetrics:
    """Least error at P = 1, A = 4; the larger P the more overshoot."""
    error = 1.0 + math.log(max(gains["P"], 1e-3)) ** 2 + math.log(gains["A"] / 4.0) ** 2
    return StepMetrics(error, 0.3 * gains["P"], 1.0, 1.0, 0.0, 0.0, 0.0)


def test_the_oracle_finds_the_least_error_and_the_held_one_keeps_its_limit():
    starts = [{"P": 0.3, "A": 1.0}, {"P": 2.0, "A": 9.0}]
    (held, free), flown = search(fly, RANGES, starts, 120, (0.15, math.inf))
    assert flown <= 120 + 6
    assert free.itae == pytest.approx(1.0, abs=0.01)
    assert held.overshoot == pytest.approx(0.15, abs=0.01)
    assert held.gains["A"] == pytest.approx(4.0, rel=0.15)


def test_no_start_beats_the_oracle():
    best = {"P": 1.0, "A": 4.0}
    (answer,), _ = search(fly, RANGES, [{"P": 0.1, "A": 2.0}, best], 4, (math.inf,))
    assert answer.gains == pytest.approx(best)


def test_the_rehearsals_thruster_is_as_strong_as_the_true_one():
    hull, thruster = true_hull(FLEET["bluerov2"])
    assert hull.alpha == pytest.approx(0.592 / 22.97)
    assert thruster.dead_zone == 0.0625
    assert thruster.static(np.array([0.6]))[0] == pytest.approx(0.70, abs=0.12)
