"""A small fixed part of the blind suite: a few hidden effects, a clean case, and one outside the catalogue.

The whole suite is ``python3 -m benchmarks.blind``; these are first cases of its seed 3.
"""

from __future__ import annotations

import pytest

from benchmarks.blind.referee import Outcome, run_case

pytestmark = pytest.mark.slow

SEED = 3


def summary(outcome: Outcome) -> str:
    return f"{outcome.truth} at {outcome.places} -> {outcome.verdict} {outcome.causes} {outcome.error}"


@pytest.mark.parametrize("slug", ["dead-zone", "gain-drift", "gyro-bias", "wind-moment"])
def test_a_hidden_effect_is_identified_first(slug: str) -> None:
    outcome = run_case("single", SEED, 0, slug)
    assert outcome.right, summary(outcome)


@pytest.mark.parametrize(("slug", "index"), [("bank-suction", 10), ("shallow-water", 0)])
def test_an_effect_that_depends_on_position_is_identified_from_the_track(slug: str, index: int) -> None:
    outcome = run_case("environment", SEED, index, slug)
    assert outcome.right, summary(outcome)


def test_a_craft_without_hidden_effects_has_no_cause() -> None:
    outcome = run_case("clean", SEED, 0, "")
    assert outcome.strictly_right, summary(outcome)


def test_an_effect_outside_the_catalogue_is_not_identified_with_confidence() -> None:
    outcome = run_case("foreign", SEED, 0, "sloshing")
    assert outcome.strictly_right, summary(outcome)


def test_two_joint_causes_are_identified_although_they_resemble_a_drifting_force() -> None:
    outcome = run_case("double", 75, 9, "")
    assert outcome.strictly_right, summary(outcome)


def test_causes_found_without_process_noise_are_tested_with_it() -> None:
    outcome = run_case("process-noise", 75, 11, "clean")
    assert outcome.strictly_right, summary(outcome)
    assert "not-under-process-noise" in outcome.doubts, "no change of mass tempts any more: another case is wanted"


@pytest.mark.parametrize(
    ("kind", "slug"),
    [("wrong-numbers", ""), ("wrong-numbers-and-effect", "dead-zone"), ("correct-model", ""), ("simulation", "")],
)
def test_wrong_numbers_are_reported_and_correct_ones_are_not(kind: str, slug: str) -> None:
    outcome = run_case(kind, SEED, 0, slug)
    assert outcome.right, f"{outcome.wrong_numbers} and {summary(outcome)}, reported {outcome.reported_numbers}"
