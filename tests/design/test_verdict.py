"""Each line of the verdict at its limit: just met and just missed, with an old step better and one worse than it."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import pytest

from gcs_autotune.design import StepMetrics, is_better

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
def test_what_just_meets_a_limit_is_kept_and_what_just_misses_it_is_not(name: str, before: float, most: float) -> None:
    old = replace(OLD, **{name: before})
    for value, is_kept in ((most * (1.0 - 1e-9), True), (most, True), (most * (1.0 + 1e-9), False)):
        verdict = is_better(old, replace(NEW, **{name: value}))
        assert verdict.better is is_kept
        assert len(verdict.reasons) == 6
        words = " ".join(verdict.reasons)
        assert ("allowed" in words or "is asked for" in words) is not is_kept


def test_the_reason_tells_old_new_and_by_how_much() -> None:
    reasons = is_better(OLD, replace(NEW, itae=3.0, overshoot=0.25, travel=1.5)).reasons
    assert reasons[0] == "error over time (ITAE) 2 -> 3 s^2, 50% higher; at least 5% lower is asked for"
    assert reasons[1] == "overshoot 0.0% -> 25.0% of the step, more than the 15.0% allowed"
    assert reasons[4] == "actuator travel 0.10 -> 1.50 full strokes per second, more than the 1.00 allowed"
    assert is_better(OLD, NEW).reasons[0] == "error over time (ITAE) 2 -> 1 s^2, 50% lower"
    nothing_to_lower = is_better(replace(OLD, itae=0.0), NEW).reasons[0]
    assert nothing_to_lower == "error over time (ITAE) 0 -> 1 s^2, higher; at least 5% lower is asked for"


@pytest.mark.parametrize(
    ("before", "after", "is_kept", "words"),
    [
        ({}, {"settling": 9.0}, True, "settled after 9.0 s"),
        ({}, {"settling": NEITHER}, False, "did not settle to 5 %; the old gains did in 3.0 s"),
        ({"settling": NEITHER}, {"settling": NEITHER}, True, "neither step was within 5 % when its record ended"),
        ({"settling": NEITHER}, {}, True, "settled after 3.0 s"),
        ({}, {"settling": NEITHER, "hidden_by_noise": True}, True, "settling cannot be read: the noise is wider"),
        ({}, {"itae": NEITHER}, False, "the new step's error could not be measured"),
        ({"itae": NEITHER}, {}, True, "before it could not be measured"),
        ({"itae": NEITHER}, {"itae": NEITHER}, False, "the new step's error could not be measured"),
    ],
)
def test_what_could_not_be_measured_speaks_against_the_new_step_only(
    before: dict[str, Any], after: dict[str, Any], is_kept: bool, words: str
) -> None:
    verdict = is_better(replace(OLD, **before), replace(NEW, **after))
    assert verdict.better is is_kept
    assert any(words in reason for reason in verdict.reasons)


def test_the_overshoot_that_the_law_itself_causes_comes_on_top_of_the_limit_only() -> None:
    assert is_better(OLD, replace(NEW, overshoot=0.24), free_overshoot=0.1).better
    assert not is_better(OLD, replace(NEW, overshoot=0.26), free_overshoot=0.1).better
    assert not is_better(OLD, replace(NEW, overshoot=0.16)).better
    assert not is_better(replace(OLD, overshoot=0.4), replace(NEW, overshoot=0.45), free_overshoot=0.1).better
