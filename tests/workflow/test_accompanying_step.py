"""The turn-rate step beside a heading step stays within the heading limit, and is left out where it tells nothing."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from gcs_autotune.design import Actuator
from gcs_autotune.errors import PreconditionFailed
from gcs_autotune.models import SingleDof
from gcs_autotune.workflow import Connection, TuneSettings
from gcs_autotune.workflow.accompanying_step import within
from gcs_autotune.workflow.proof import Known, proof_of_turn_rate

DEG = math.pi / 180.0
BOAT = Known(SingleDof("yaw", "1", 0.858, 1.494), Actuator(), 0.1 * DEG)
SETTINGS = TuneSettings(Connection("memory"), Path("run"), axis="heading", step=10.0 * DEG, step_duration=30.0)


@pytest.mark.parametrize("speed", [1.5, 0.0])
def test_it_is_not_sized_by_the_heading_step_that_was_asked_for(speed: float) -> None:
    s = proof_of_turn_rate(SETTINGS, speed, BOAT, beside=True).settings
    assert s.size > 20.0 * DEG
    assert s.duration <= 6.0
    assert s.base == pytest.approx(-0.5 * s.size)


def test_its_turn_rates_are_reduced_to_stay_within_the_heading_limit() -> None:
    proof = proof_of_turn_rate(SETTINGS, 1.5, BOAT, beside=True)
    assert within(120.0 * DEG, proof, BOAT) is proof
    s = within(50.0 * DEG, proof, BOAT).settings
    assert 0.5 * s.size * max(s.settle, s.duration) == pytest.approx(40.0 * DEG)
    assert s.base == pytest.approx(-0.5 * s.size)
    with pytest.raises(PreconditionFailed, match="--max-heading-excursion 1 leaves no space"):
        within(1.0 * DEG, proof, BOAT)
