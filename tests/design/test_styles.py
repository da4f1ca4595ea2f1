"""Styles: margins and bandwidth in numbers, and what the proof then accepts."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from gcs_autotune.design import (
    STYLE_STEPS,
    STYLES,
    Proposal,
    Spec,
    StepMetrics,
    design,
    is_better,
    style_number,
    style_of,
)
from gcs_autotune.errors import UsageError

from .crafts import DEG, ROVER_DEFAULTS, ROVER_HEADING, yaw

HULL = yaw(3.0, 1.5, 0.5, delay=0.1)
COVARIANCE = np.diag([0.06, 0.08, 0.03, 1e-3, 1e-2]) ** 2
STEP = StepMetrics(itae=2.0, overshoot=0.05, rise=1.0, settling=3.0, steady_error=0.0, travel=0.4, oscillation=0.0)


def designed(style: str) -> Proposal:
    chosen = STYLES[style]
    spec = Spec(
        step=30.0 * DEG,
        step_duration=30.0,
        speed=1.2,
        bandwidth=chosen.bandwidth,
        gain_margin=chosen.gain_margin,
        phase_margin=chosen.phase_margin,
    )
    return design(HULL, COVARIANCE, ROVER_HEADING, ROVER_DEFAULTS, spec)


def test_the_normal_style_is_the_default_specification() -> None:
    usual = Spec()
    assert (usual.bandwidth, usual.gain_margin, usual.phase_margin) == (
        STYLES["normal"].bandwidth,
        STYLES["normal"].gain_margin,
        STYLES["normal"].phase_margin,
    )


@pytest.mark.slow
def test_the_margins_of_a_style_are_kept_and_a_gentle_loop_is_slower() -> None:
    found = {style: designed(style) for style in STYLES}
    for style, proposal in found.items():
        assert proposal.worst_margins.gain >= STYLES[style].gain_margin
        assert proposal.worst_margins.phase >= STYLES[style].phase_margin
    rise = {style: proposal.after.metrics.rise for style, proposal in found.items()}
    assert rise["gentle"] >= 1.9 * rise["normal"]
    assert found["gentle"].after.metrics.travel < 0.8 * found["normal"].after.metrics.travel
    assert found["quick"].after.metrics.itae <= 1.02 * found["normal"].after.metrics.itae


def test_a_slower_loop_is_better_for_a_gentle_style_if_the_actuator_travels_less() -> None:
    gentle = STYLES["gentle"]
    slower = replace(STEP, itae=7.0, rise=2.0, travel=0.2)
    assert not is_better(STEP, slower).better
    verdict = is_better(STEP, slower, slower=gentle.slower)
    assert verdict.better
    assert "a slower loop is required and the actuator travels 50% less" in verdict.reasons[0]
    assert not is_better(STEP, replace(slower, itae=8.1), slower=gentle.slower).better
    assert not is_better(STEP, replace(slower, travel=0.39), slower=gentle.slower).better
    assert not is_better(STEP, replace(slower, overshoot=0.3), slower=gentle.slower).better


def test_a_number_is_interpolated_between_styles() -> None:
    assert style_of("50") == style_of("normal") == STYLES["normal"]
    between = style_of("25")
    assert (between.bandwidth, between.gain_margin) == (0.75, 3.0)
    assert math.isclose(math.degrees(between.phase_margin), 52.5)
    assert style_of("75").gain_margin == 2.25
    places = [style_number(name) for name in STYLE_STEPS]
    assert places == sorted(places) and {0.0, 50.0, 100.0} <= set(places)
    for wrong in ("-1", "101", "nan", "fast", ""):
        with pytest.raises(UsageError, match="from 0"):
            style_of(wrong)


def test_a_style_states_its_numbers() -> None:
    assert str(STYLES["gentle"]) == (
        "50% of the bandwidth of the fastest loop with a gain margin of 3.5 and a phase margin of 60 deg"
    )
    assert math.isclose(STYLES["gentle"].slower, 4.0)
