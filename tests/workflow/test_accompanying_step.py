"""The turn-rate step that accompanies a heading step stays within the heading limit."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import pytest

from gcs_autotune.design import Actuator
from gcs_autotune.errors import PreconditionFailed
from gcs_autotune.manoeuvres import STOPPING, Envelope
from gcs_autotune.models import SingleDof
from gcs_autotune.workflow import Connection, TuneSettings
from gcs_autotune.workflow.proof import Known, farthest_turn, proof_of_turn_rate, turn_sentence

DEG = math.pi / 180.0
BOAT = Known(SingleDof("yaw", "1", 0.858, 1.494), Actuator(), 0.1 * DEG)
SETTINGS = TuneSettings(Connection("memory"), Path("run"), axis="heading", step=10.0 * DEG, step_duration=30.0)


@pytest.mark.parametrize("speed", [1.5, 0.0])
def test_the_size_is_independent_of_the_requested_heading_step(speed: float) -> None:
    s = proof_of_turn_rate(SETTINGS, speed, BOAT, beside=True).settings
    assert s.size > 20.0 * DEG
    assert s.duration <= 6.0
    assert s.base == pytest.approx(-0.5 * s.size)


def test_the_turn_rate_step_is_reduced_to_keep_a_margin_to_the_heading_limit() -> None:
    wide = proof_of_turn_rate(_within(math.inf), 1.5, BOAT, beside=True).settings
    assert farthest_turn(wide) == pytest.approx(0.5 * wide.size * (6.0 + STOPPING))
    s = proof_of_turn_rate(_within(50.0 * DEG), 1.5, BOAT, beside=True).settings
    assert farthest_turn(s) == pytest.approx(0.85 * 50.0 * DEG)
    assert s.size < wide.size and s.base == pytest.approx(-0.5 * s.size)
    with pytest.raises(PreconditionFailed, match="heading limit of 1 deg is too small"):
        proof_of_turn_rate(_within(1.0 * DEG), 1.5, BOAT, beside=True)


def test_a_requested_turn_rate_step_that_turns_too_far_is_rejected() -> None:
    requested = replace(SETTINGS, axis="yaw", step=60.0 * DEG, step_duration=8.0)
    with pytest.raises(PreconditionFailed, match=r"step of 60 deg/s for 8\.0 s may turn the craft by 234 deg"):
        proof_of_turn_rate(requested, 0.0, BOAT)
    assert proof_of_turn_rate(replace(requested, step=20.0 * DEG), 0.0, BOAT).settings.size == 20.0 * DEG


def test_the_turn_is_announced_with_its_limit() -> None:
    s = proof_of_turn_rate(SETTINGS, 0.0, BOAT, beside=True).settings
    reported = turn_sentence(s, 120.0 * DEG)
    assert f"turns the craft by up to {farthest_turn(s) / DEG:.0f} deg. It ends early" in reported
    assert "before the limit of 120 deg" in reported


def _within(limit: float) -> TuneSettings:
    return replace(SETTINGS, envelope=Envelope(heading_excursion=limit))
