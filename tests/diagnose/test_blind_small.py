"""A small fixed part of the blind suite: a few hidden effects, nothing at all, and one that is in no book.

The whole suite is ``python3 -m benchmarks.blind``; these are first cases of its seed 3.
"""

from __future__ import annotations

import pytest

from benchmarks.blind.referee import Outcome, run_case

pytestmark = pytest.mark.slow

SEED = 3


def the(outcome: Outcome) -> str:
    return f"{outcome.truth} at {outcome.places} -> {outcome.verdict} {outcome.causes} {outcome.error}"


@pytest.mark.parametrize("slug", ["dead-zone", "gain-drift", "gyro-bias", "wind-moment"])
def test_a_hidden_effect_is_named_first(slug: str) -> None:
    outcome = run_case("single", SEED, 0, slug)
    assert outcome.right, the(outcome)


@pytest.mark.parametrize(("slug", "index"), [("bank-suction", 10), ("shallow-water", 0)])
def test_what_depends_on_the_place_is_named_from_the_track(slug: str, index: int) -> None:
    outcome = run_case("environment", SEED, index, slug)
    assert outcome.right, the(outcome)


def test_nothing_is_found_where_nothing_is_hidden() -> None:
    outcome = run_case("clean", SEED, 0, "")
    assert outcome.strictly_right, the(outcome)


def test_what_is_in_no_book_gets_no_confident_name() -> None:
    outcome = run_case("foreign", SEED, 0, "sloshing")
    assert outcome.strictly_right, the(outcome)


def test_two_causes_that_only_pay_together_are_named_though_they_look_like_a_force_that_wanders() -> None:
    outcome = run_case("double", 75, 9, "")
    assert outcome.strictly_right, the(outcome)


def test_what_a_search_without_weather_names_is_weighed_beside_the_force_that_wanders() -> None:
    outcome = run_case("process-noise", 75, 11, "clean")
    assert outcome.strictly_right, the(outcome)
    assert "not-under-process-noise" in outcome.doubts, "no change of mass tempts any more: another case is wanted"


@pytest.mark.parametrize(
    ("kind", "slug"),
    [("wrong-numbers", ""), ("wrong-numbers-and-effect", "dead-zone"), ("correct-model", ""), ("simulation", "")],
)
def test_wrong_numbers_are_told_and_honest_ones_left_alone(kind: str, slug: str) -> None:
    outcome = run_case(kind, SEED, 0, slug)
    assert outcome.right, f"{outcome.numbers} and {the(outcome)}, doubted {outcome.doubted}"
