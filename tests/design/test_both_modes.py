"""One set of gains holds headings and follows turn rates; the cost of the documented ranges is reported."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
import pytest

from gcs_autotune.design import LAWS, Proposal, Scenario, Spec, design
from gcs_autotune.design.laws.rover_heading import alike
from gcs_autotune.firmware import FIRMWARE
from gcs_autotune.models import SingleDof

from .crafts import DEG, ROVER_DEFAULTS, ROVER_HEADING, yaw

QUICK, SLOW = yaw(0.858, 1.494), yaw(16.36, 4.912)
"""A twin-thruster boat of 1.4 m at 1.5 m/s, and a catamaran of 2.4 m at 1.2 m/s; inputs in fractions of full output."""
SURE = np.zeros((5, 5))


def propose(model: SingleDof, speed: float, seconds: float, **spec: bool) -> Proposal:
    specification = Spec(speed=speed, step_duration=seconds, hold=0.0, noise_std=0.1 * DEG, **spec)
    return design(model, SURE, ROVER_HEADING, {**ROVER_DEFAULTS, "SCHED_LOOP_RATE": 50.0}, specification)


@pytest.fixture(scope="module")
def proposals() -> Mapping[str, Proposal]:
    return {
        "quick": propose(QUICK, 1.5, 10.0),
        "slow": propose(SLOW, 1.2, 40.0),
        "slow beyond": propose(SLOW, 1.2, 40.0, beyond_ranges=True),
    }


def reached(model: SingleDof, proposal: Proposal, speed: float, rate: float, seconds: float) -> float:
    """Return the share of a turn rate [rad/s] that is reached after *seconds* from going straight."""
    settings = {**ROVER_DEFAULTS, **proposal.new}
    motion = LAWS["rover-yaw"].simulate(model, settings, Scenario(rate, seconds, lead=1e-9), speed, 0.03)
    return float(motion.position[-1]) / rate


@pytest.mark.slow
def test_heading_gains_follow_turn_rates_if_both_are_possible(proposals: Mapping[str, Proposal]) -> None:
    beside = proposals["quick"].beside
    assert beside is not None
    assert beside.law == "rover-yaw"
    assert beside.before > 0.3
    assert beside.after < 0.01
    assert beside.given_up <= 0.05
    assert reached(QUICK, proposals["quick"], 1.5, 20.0 * DEG, 2.0) == pytest.approx(1.0, abs=0.03)


@pytest.mark.slow
def test_the_shortfall_in_turn_rates_is_reported(proposals: Mapping[str, Proposal]) -> None:
    for name in ("quick", "slow"):
        beside = proposals[name].beside
        assert beside is not None
        (note,) = (n for n in proposals[name].notes if n.startswith("turn rates (AUTO, ACRO)"))
        assert f"predicted tracking shortfall {beside.after:.1%}" in note
        assert f"{beside.before:.1%} with the present gains" in note


@pytest.mark.slow
def test_the_cost_of_documented_ranges_is_reported_and_exceeded_on_request(
    proposals: Mapping[str, Proposal],
) -> None:
    inside, beyond = proposals["slow"], proposals["slow beyond"]
    (note,) = (n for n in inside.notes if "--beyond-ranges" in n)
    assert "ATC_STR_RAT_P" in note
    assert "s^2" not in note, "a figure over other times than those of the table beside it"
    assert not any(c.beyond for c in inside.changes)
    assert any(c.beyond for c in beyond.changes)
    assert not any("--beyond-ranges" in n for n in beyond.notes)
    assert beyond.after.metrics.itae < 0.7 * inside.after.metrics.itae
    assert beyond.beside is not None
    assert inside.beside is not None
    assert beyond.beside.after < 0.2 * inside.beside.after
    assert beyond.worst_margins.gain >= 2.5
    assert beyond.worst_margins.phase >= 45.0 * DEG - 1e-3


def test_ranges_that_do_not_limit_a_craft_are_not_mentioned() -> None:
    proposal = propose(yaw(0.1, 0.17), 1.5, 10.0)
    assert not any("--beyond-ranges" in n for n in proposal.notes)


def test_gains_with_another_feed_forward_give_the_same_heading_step() -> None:
    gains = {**ROVER_DEFAULTS, "ATC_STR_RAT_FF": 0.8, "ATC_STR_RAT_P": 2.0, "ATC_STR_ANG_P": 3.0}
    steps = [
        LAWS["rover-heading"].simulate(QUICK, settings, Scenario(10.0 * DEG, 6.0), 1.5, 0.03).position
        for settings in (gains, alike(gains, 1.4))
    ]
    assert np.max(np.abs(steps[1] - steps[0])) < 0.08 * 10.0 * DEG
    assert np.max(np.abs(steps[0])) > 0.9 * 10.0 * DEG


def test_a_turn_rate_design_predicts_its_effect_on_headings() -> None:
    axis = FIRMWARE["ardurover"].axes["yaw"]
    assert "ATC_STR_ANG_P" in axis.context
    spec = Spec(speed=1.5, step=25.0 * DEG, step_duration=6.0, hold=0.0)
    known = design(QUICK, SURE, axis, ROVER_DEFAULTS, spec)
    assert known.beside is not None
    assert known.beside.law == "rover-heading"
    assert math.isfinite(known.beside.after)
    without = {name: value for name, value in ROVER_DEFAULTS.items() if name != "ATC_STR_ANG_P"}
    assert design(QUICK, SURE, axis, without, spec).beside is None
