"""The gains that hold a position: the stiffest within the ranges that keep the margins."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from gcs_autotune.design import (
    POSITION_GAINS,
    UNSTABLE,
    PositionMetrics,
    Stay,
    design_position,
    holds_better,
    loiter_change,
    position_metrics,
)
from gcs_autotune.errors import NoGainsMeetSpec
from gcs_autotune.models import SingleDof

PRESENT = {g.parameter: g.default for g in POSITION_GAINS}
FIGURES = PositionMetrics(itae=7.0, rise=4.0, overshoot=0.06, hold=0.03, push=0.1, excursion=0.2, travel=0.2)


def motions(alpha: float = 0.25, drag: float = 0.5, delay: float = 0.0):
    model = SingleDof("surge", "1", alpha, drag, 0.0, 0.0, delay)
    covariance = np.diag([(0.05 * alpha) ** 2, (0.05 * drag) ** 2, 0.0, 1e-6, 1e-4])
    return [(model, covariance), (replace(model, alpha=1.2 * alpha), covariance)]


@pytest.mark.parametrize("delay", [0.0, 0.1, 0.3, 0.6])
def test_the_margins_hold_over_both_motions(delay: float) -> None:
    found = design_position(motions(delay=delay), PRESENT)
    assert found.margins.stable
    assert found.margins.gain >= 2.5
    assert found.margins.phase >= math.radians(45.0)
    assert all(g.low <= found.gains[g.parameter] <= g.high for g in POSITION_GAINS)


def test_a_longer_delay_lowers_the_stiffness() -> None:
    stiffness = [
        found["PSC_POSXY_P"] * found["PSC_VELXY_P"]
        for found in (design_position(motions(delay=delay), PRESENT).gains for delay in (0.1, 0.3, 0.5))
    ]
    assert stiffness == sorted(stiffness, reverse=True)
    assert stiffness[0] > 2.0 * stiffness[-1]


def test_an_oscillating_present_loop_is_recognised() -> None:
    assert not design_position(motions(drag=0.1, delay=0.5), PRESENT).present.stable


def test_a_craft_beyond_the_ranges_is_rejected_with_its_delay() -> None:
    with pytest.raises(NoGainsMeetSpec, match="delay is 4"):
        design_position(motions(alpha=0.02, drag=0.001, delay=4.0), PRESENT)


@pytest.mark.parametrize(("noise", "radius"), [(0.03, 0.5), (0.3, 1.5)])
def test_a_noisy_position_needs_a_larger_radius(noise: float, radius: float) -> None:
    found = loiter_change(noise, {"LOIT_RADIUS": 2.0})
    assert found is not None
    assert found.new == pytest.approx(radius)


def test_a_radius_that_is_small_enough_is_kept() -> None:
    assert loiter_change(0.03, {"LOIT_RADIUS": 0.4}) is None


def _flight(lag: float, push: float) -> PositionMetrics:
    t = np.arange(0.0, 34.0, 0.1)
    gone = np.where(t < 10.0, 0.0, 1.0 - np.exp(-np.maximum(t - 10.0, 0.0) / lag)) * (1 + 1j)
    pushed = np.where((t > 10.0) & (t < 20.0), push, 0.0) + 0j
    rest = Stay(4.0, 9.0, 0j, 0j)
    return position_metrics(
        (t, gone), [Stay(10.0, 34.0, 1 + 1j, 0j)], (t, pushed), [Stay(10.0, 34.0, 0j, 0j)], [rest], 0.2
    )


def test_the_figures_match_a_known_flight() -> None:
    found = _flight(2.0, 0.3)
    assert found.itae == pytest.approx(2.0**2, rel=0.05)  # the integral of t exp(-t / T)
    assert found.rise == pytest.approx(2.0 * math.log(10.0), abs=0.15)
    assert found.excursion == pytest.approx(0.3, abs=0.01)
    assert found.push == pytest.approx(0.3 * math.sqrt(10.0 / 24.0), rel=0.05)
    assert found.hold == pytest.approx(0.0, abs=1e-9)


def test_better_step_and_push_are_kept_and_a_worse_one_is_not() -> None:
    assert holds_better(FIGURES, replace(FIGURES, itae=5.0, push=0.07)).better
    assert not holds_better(FIGURES, FIGURES).better
    assert not holds_better(FIGURES, replace(FIGURES, itae=5.0, push=0.12)).better
    assert not holds_better(FIGURES, replace(FIGURES, itae=5.0, push=0.07, overshoot=0.2)).better
    assert not holds_better(FIGURES, replace(FIGURES, itae=5.0, push=0.07, travel=1.5)).better


def test_the_distance_while_holding_is_compared_without_pushes() -> None:
    unpushed = replace(FIGURES, hold=0.5, push=math.nan, excursion=math.nan)
    closer = holds_better(unpushed, replace(unpushed, hold=0.3), pushed=False)
    assert closer.better
    assert "distance while holding, rms 0.5 -> 0.3 m" in closer.reasons
    assert not holds_better(unpushed, replace(unpushed, itae=5.0, hold=0.8), pushed=False).better


def test_a_stable_loop_is_better_than_an_unstable_one() -> None:
    assert holds_better(UNSTABLE, FIGURES).better
    assert not holds_better(FIGURES, UNSTABLE).better
    assert not holds_better(UNSTABLE, UNSTABLE).better
