"""Each line of the verdict at its limit: just met and just missed, with an old step better and one worse than it."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import pytest

from gcs_autotune.design import StepMetrics, is_better, is_no_worse, scatter_of

OLD = StepMetrics(itae=2.0, overshoot=0.0, rise=1.0, settling=3.0, steady_error=0.0, travel=0.1)
NEW = replace(OLD, itae=1.0)
NEITHER = math.nan


@pytest.mark.parametrize(
    ("name", "before", "most"),
    [
        ("itae", 2.0, 1.9),
        ("overshoot", 0.0, 0.15),
        ("overshoot", 0.5, 0.5),
        ("oscillation", 0.0, 0.05),
        ("oscillation", 0.3, 0.3),
        ("steady_error", 0.0, 0.05),
        ("steady_error", 0.3, 0.3),
        ("travel", 0.1, 1.0),
        ("travel", 2.0, 6.0),
    ],
)
def test_a_value_at_its_limit_is_kept_and_just_beyond_it_is_not(name: str, before: float, most: float) -> None:
    old = replace(OLD, **{name: before})
    for value, is_kept in ((most * (1.0 - 1e-9), True), (most, True), (most * (1.0 + 1e-9), False)):
        verdict = is_better(old, replace(NEW, **{name: value}))
        assert verdict.better is is_kept
        assert len(verdict.reasons) == 6
        words = " ".join(verdict.reasons)
        assert ("allowed" in words or "is required" in words) is not is_kept


def test_the_reason_states_old_and_new_value_and_the_difference() -> None:
    reasons = is_better(OLD, replace(NEW, itae=3.0, overshoot=0.25, travel=1.5)).reasons
    assert reasons[0] == "tracking error (ITAE) 2 -> 3 s^2, 50% higher, but at least 5% lower is required"
    assert reasons[1] == "overshoot 0.0% -> 25.0% of the step, more than the 15.0% allowed"
    assert reasons[4] == "actuator travel 0.10 -> 1.50 full strokes per second, more than the 1.00 allowed"
    assert is_better(OLD, NEW).reasons[0] == "tracking error (ITAE) 2 -> 1 s^2, 50% lower"
    nothing_to_lower = is_better(replace(OLD, itae=0.0), NEW).reasons[0]
    assert nothing_to_lower == "tracking error (ITAE) 0 -> 1 s^2, higher, but at least 5% lower is required"


@pytest.mark.parametrize(
    ("before", "after", "is_kept", "words"),
    [
        ({}, {"settling": 9.0}, True, "settled after 9.0 s"),
        ({}, {"settling": NEITHER}, False, "not settled within 5 %, although the old gains settled in 3.0 s"),
        ({"settling": NEITHER}, {"settling": NEITHER}, True, "neither step settled within 5 % during its record"),
        (
            {"settling": NEITHER, "hidden_by_noise": True},
            {"settling": NEITHER},
            True,
            "The old gains' settling time was not measurable",
        ),
        ({"settling": NEITHER}, {}, True, "settled after 3.0 s"),
        (
            {},
            {"settling": NEITHER, "hidden_by_noise": True},
            True,
            "settling time not measurable, because readings leave",
        ),
        ({}, {"itae": NEITHER}, False, "the tracking error of the new step could not be measured"),
        ({"itae": NEITHER}, {}, True, "not measurable before"),
        ({"itae": NEITHER}, {"itae": NEITHER}, False, "the tracking error of the new step could not be measured"),
    ],
)
def test_an_unmeasurable_figure_counts_only_against_the_new_step(
    before: dict[str, Any], after: dict[str, Any], is_kept: bool, words: str
) -> None:
    verdict = is_better(replace(OLD, **before), replace(NEW, **after))
    assert verdict.better is is_kept
    assert any(words in reason for reason in verdict.reasons)


def test_overshoot_caused_by_the_law_is_added_only_to_the_limit() -> None:
    assert is_better(OLD, replace(NEW, overshoot=0.24), free_overshoot=0.1).better
    assert not is_better(OLD, replace(NEW, overshoot=0.26), free_overshoot=0.1).better
    assert not is_better(OLD, replace(NEW, overshoot=0.16)).better
    assert not is_better(replace(OLD, overshoot=0.4), replace(NEW, overshoot=0.45), free_overshoot=0.1).better


def halves(*oscillations: float) -> list[StepMetrics]:
    return [replace(OLD, oscillation=x) for x in oscillations]


def test_an_oscillation_within_the_measurement_scatter_counts_as_equal() -> None:
    old, new = replace(OLD, oscillation=0.071), replace(NEW, oscillation=0.082)
    assert not is_better(old, new).better
    scatter = scatter_of(halves(0.055, 0.071), halves(0.082, 0.07))
    assert scatter["oscillation"] == pytest.approx(math.sqrt((0.016**2 + 0.012**2) / 4.0))
    verdict = is_better(old, new, scatter=scatter)
    assert verdict.better
    assert "remaining oscillation 7.1% -> 8.2% of the step, within the measurement scatter" in verdict.reasons
    assert is_better(old, new, scatter=scatter_of(halves(0.071, 0.071), halves(0.082, 0.082))).better
    assert not is_better(old, replace(new, oscillation=0.16), scatter=scatter).better


def test_scatter_does_not_widen_the_absolute_limits() -> None:
    scatter = scatter_of(halves(0.0, 0.01), halves(0.0, 0.01))
    assert not is_better(OLD, replace(NEW, oscillation=0.051), scatter=scatter).better
    assert scatter_of(halves(0.1), halves())["oscillation"] == 0.0


def test_a_gain_in_the_other_mode_allows_only_a_small_loss() -> None:
    for itae, other, is_kept in ((2.1, 0.8, True), (2.11, 0.1, False), (2.0, 0.81, False), (1.9, 2.0, True)):
        assert is_better(OLD, replace(NEW, itae=itae), other=(1.0, other)).better is is_kept


@pytest.mark.parametrize(
    ("changed", "good"),
    [
        ({"itae": 2.19}, True),
        ({"itae": 2.21}, False),
        ({"itae": math.nan}, False),
        ({"overshoot": 0.149}, True),
        ({"overshoot": 0.151}, False),
        ({"oscillation": 0.051}, False),
        ({"steady_error": 0.051}, False),
        ({"travel": 1.1}, False),
    ],
)
def test_a_change_with_another_aim_may_leave_tracking_unchanged(changed: dict[str, float], good: bool) -> None:
    assert is_no_worse(OLD, replace(OLD, **changed), {}).better is good


def test_a_difference_as_between_equal_steps_is_no_worse() -> None:
    old = replace(OLD, overshoot=0.4, oscillation=0.2, steady_error=0.2)
    assert is_no_worse(old, replace(old, overshoot=0.42, oscillation=0.22, steady_error=0.22), {}).better
    assert not is_no_worse(old, replace(old, steady_error=0.24), {}).better
    assert is_no_worse(old, replace(old, steady_error=0.24), {"steady_error": 0.02}).better
