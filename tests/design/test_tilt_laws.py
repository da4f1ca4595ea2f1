"""The laws of roll and pitch are those of the heading, with the moment that rights the craft in the simulation."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from gcs_autotune.design import LAWS
from gcs_autotune.design.laws import Scenario
from gcs_autotune.firmware import FIRMWARE
from gcs_autotune.models import SingleDof

GAINS = {"P": 0.2, "I": 0.1, "D": 0.0}
CRAFT = SingleDof("roll", "1", 0.05, 0.02, 0.05, delay=0.03)
STEP = Scenario(math.radians(20.0), 4.0)


def of(letters: str) -> dict[str, float]:
    own = {f"ATC_RAT_{letters}_{n}": v for n, v in GAINS.items()}
    filters = {f"ATC_RAT_{letters}_{n}": 20.0 for n in ("FLTT", "FLTD")} | {f"ATC_RAT_{letters}_IMAX": 0.4}
    one = {"RLL": "R", "PIT": "P", "YAW": "Y"}[letters]
    limits = {f"ATC_ACCEL_{one}_MAX": 110000.0, f"ATC_RATE_{one}_MAX": 0.0}
    slew = {"ATC_SLEW_YAW": 1e8} if letters == "YAW" else {}
    return {**own, **filters, **limits, **slew, f"ATC_ANG_{letters}_P": 5.0}


@pytest.mark.parametrize(("law", "letters"), [("sub-roll", "RLL"), ("sub-pitch", "PIT")])
def test_with_the_same_numbers_the_loop_is_that_of_the_heading(law: str, letters: str) -> None:
    mine = LAWS[law].simulate(CRAFT, of(letters), STEP, None, 0.0)
    heading = LAWS["sub-heading"].simulate(CRAFT, of("YAW"), STEP, None, 0.0)
    assert np.array_equal(mine.position, heading.position)
    s = np.array([0.3j, 4.0j, 30.0j])
    assert LAWS[law].controller(of(letters), None).at(s) == pytest.approx(
        LAWS["sub-heading"].controller(of("YAW"), None).at(s)
    )
    assert set(LAWS[law].tuned) < {gain.parameter for gain in FIRMWARE["ardusub"].axes[law[4:]].gains}


def test_a_restoring_moment_is_held_by_the_output_at_the_end_of_the_step() -> None:
    righted = replace(CRAFT, restoring=0.2)
    motion = LAWS["sub-roll"].simulate(righted, of("RLL"), replace(STEP, duration=20.0), None, 0.0)
    assert motion.position[-1] == pytest.approx(STEP.step, rel=0.01)
    assert motion.output[-1] == pytest.approx(0.2 * STEP.step, rel=0.02)
