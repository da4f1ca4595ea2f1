"""Loops on a velocity: ArduRover's speed and turn rate, ArduSub's turn rate under the stick."""

from __future__ import annotations

import math
from typing import Any

import control
import numpy as np
import pytest

from gcs_autotune.design import (
    LAWS,
    Actuator,
    Proposal,
    Reduction,
    Scenario,
    Spec,
    design,
    is_better,
    pulse_of,
    throttle_of,
)
from gcs_autotune.design.laws import SKID, THROTTLE, LoopStart
from gcs_autotune.design.open_loop import Rational, constant, open_loop
from gcs_autotune.firmware import FIRMWARE
from gcs_autotune.models import SingleDof

from .crafts import (
    CHARLIE,
    ROVER_DEFAULTS,
    ROVER_SPEED_DEFAULTS,
    SUB_HEADING_DEFAULTS,
    boat,
    surge,
    uncertain,
    yaw,
)

SPEED, TURN, SUB_TURN = LAWS["rover-speed"], LAWS["rover-yaw"], LAWS["sub-yaw"]
AXIS = FIRMWARE["ardurover"].axes["speed"]
DEG = math.pi / 180.0
FREE = {"ATC_ACCEL_MAX": 0.0, "MOT_SLEWRATE": 0.0, "ATC_SPEED_FLTE": 0.0}

BOATS: dict[str, tuple[SingleDof, float, float]] = {
    "catamaran, plain propellers": (surge(4.0, 0.0, 0.444), 1.0, 1.2),
    "small twin, straight thrust": (surge(0.378, 0.266), 0.0, 1.5),
    "motorboat without inertia to speak of": (surge(0.04, 0.0, 0.01), 0.0, 5.0),
}
"""Name -> (model, square share of the thrust, speed [m/s]): sitl's Charlie and BlueBoat, ArduPilot's own motorboat."""


def proposal_for(name: str, **changes: Any) -> Proposal:
    model, square, top = BOATS[name]
    curve = Actuator(square=square)
    throttle = curve.output_for((model.beta + model.beta_quadratic * top) * top)
    pair = {"CRUISE_SPEED": top, "CRUISE_THROTTLE": round(100.0 * throttle)}
    spec = Spec(step=0.4 * top, speed=0.6 * top, step_duration=15.0, noise_std=0.005 * top, measured=pair, **changes)
    covariance = uncertain(model)
    reduction = Reduction(model, "X", covariance, curve)
    return design(model, covariance, AXIS, ROVER_SPEED_DEFAULTS, spec, reduction)


@pytest.mark.parametrize("name", BOATS)
def test_a_speed_step_is_predicted_to_improve_with_margins_over_the_region(name: str) -> None:
    proposal = proposal_for(name)
    assert is_better(proposal.before.metrics, proposal.after.metrics).better
    assert proposal.worst_margins.stable
    assert proposal.worst_margins.gain >= 2.0
    assert math.degrees(proposal.worst_margins.phase) >= 30.0
    assert proposal.new["CRUISE_SPEED"] == BOATS[name][2]
    assert all(c.low <= c.new <= c.high for c in proposal.changes)
    assert all(math.isnan(b) for b in proposal.bound)
    assert proposal.to_dict()["bound"] == [None, None]


def test_a_requested_settling_time_is_met_by_a_speed_loop() -> None:
    proposal = proposal_for("small twin, straight thrust", settling_time=3.0)
    assert proposal.after.metrics.settling == pytest.approx(3.0, rel=0.4)


def test_the_cruise_pair_alone_holds_the_speed_with_quadratic_thrust_and_drag() -> None:
    model, square, top = BOATS["catamaran, plain propellers"]
    throttle = math.sqrt(model.beta_quadratic) * top
    gains = {**ROVER_SPEED_DEFAULTS, "ATC_SPEED_P": 0.0, "ATC_SPEED_I": 0.0}
    gains |= {"CRUISE_SPEED": top, "CRUISE_THROTTLE": 100.0 * throttle}
    motion = SPEED.simulate(model, gains, Scenario(0.5, 60.0), 0.7, 0.0, Actuator(square=square))
    assert motion.position[0] == pytest.approx(0.0, abs=1e-6)
    assert motion.position[-1] == pytest.approx(0.5, abs=1e-3)
    assert motion.output[-1] == pytest.approx(throttle, abs=1e-3)


def test_a_step_back_returns_to_the_base_speed() -> None:
    model, _, _ = BOATS["small twin, straight thrust"]
    down = SPEED.simulate(model, ROVER_SPEED_DEFAULTS, Scenario(-0.6, 40.0), 0.9, 0.0)
    assert down.output[0] == pytest.approx(model.beta * 1.5, abs=0.01)
    assert down.output[-1] == pytest.approx(model.beta * 0.9, abs=0.01)


def test_a_step_from_a_loop_that_is_not_at_rest_continues_its_motion() -> None:
    model, square, top = BOATS["catamaran, plain propellers"]
    gains = {**ROVER_SPEED_DEFAULTS, **FREE, "CRUISE_SPEED": top, "CRUISE_THROTTLE": 80.0, "MOT_THST_EXPO": 0.3}
    base, step, after = 0.6 * top, 0.4 * top, 3.0
    whole = SPEED.simulate(model, gains, Scenario(-step, 40.0, back_at=after), base, 0.0, Actuator(square=square))
    k = int(np.searchsorted(whole.t, after))
    start = LoopStart(whole.position[k] + step, whole.output[k - 1])
    assert abs(start.ahead) > 0.1 * step  # not at rest
    flown = SPEED.simulate(model, gains, Scenario(step, 30.0, start=start), base, 0.0, Actuator(square=square))
    n = len(flown.t)
    np.testing.assert_allclose(flown.position, whole.position[k : k + n] + step, atol=0.01 * step)
    np.testing.assert_allclose(flown.output, whole.output[k : k + n], atol=0.02)


def test_the_speed_loop_includes_acceleration_limit_slew_rate_and_largest_throttle() -> None:
    model, _, _ = BOATS["small twin, straight thrust"]
    quick = {**ROVER_SPEED_DEFAULTS, "ATC_SPEED_P": 2.0, **FREE}
    free = SPEED.simulate(model, quick, Scenario(0.5, 10.0), 1.0, 0.0)
    for limit in ({"ATC_ACCEL_MAX": 0.25}, {"MOT_SLEWRATE": 10.0}, {"MOT_THR_MAX": 42.0}):
        held = SPEED.simulate(model, {**quick, **limit}, Scenario(0.5, 10.0), 1.0, 0.0)
        assert held.position[50] < 0.8 * free.position[50]
        assert held.output.max() <= limit.get("MOT_THR_MAX", 100.0) / 100.0
    ramp = SPEED.simulate(model, {**quick, "ATC_ACCEL_MAX": 0.25}, Scenario(0.5, 10.0), 1.0, 0.0)
    assert np.max(np.gradient(ramp.position, ramp.t)) < 0.32


def test_the_throttle_curve_is_applied_after_the_minimum_and_can_be_inverted() -> None:
    settings = {"MOT_THR_MIN": 10.0, "MOT_THST_EXPO": 0.7}
    for throttle in (-1.0, -0.3, 0.01, 0.5, 1.0):
        pulse = pulse_of(throttle, settings)
        lifted = 0.1 + 0.9 * abs(throttle)
        assert 0.3 * abs(pulse) + 0.7 * pulse * pulse == pytest.approx(lifted)
        assert throttle_of(pulse, settings) == pytest.approx(throttle)
    assert pulse_of(0.0, settings) == throttle_of(0.0, settings) == 0.0


def test_the_linear_loop_predicts_small_speed_steps() -> None:
    """Target to speed: ``(controller + cruise) plant / (1 + controller plant)``, the slope of the drag in the plant."""
    model = surge(1.0, 0.1, 0.15)
    settings = {**ROVER_SPEED_DEFAULTS, **FREE, "ATC_SPEED_P": 0.8, "ATC_SPEED_I": 0.3}
    step, base, delay = 1e-4, 1.5, 0.06
    motion = SPEED.simulate(model, settings, Scenario(step, 15.0), base, delay)
    drag = model.beta + 2.0 * model.beta_quadratic * base
    controller = SPEED.controller(settings, base)
    loop = open_loop(controller, model.alpha, drag, delay)
    forward = open_loop(controller + constant(0.25), model.alpha, drag, delay).to_control()
    closed = control.minreal(forward / (1 + loop.to_control()), tol=1e-6, verbose=False)
    t = np.linspace(0.0, 15.0, 751)
    expected = control.step_response(closed, t).outputs
    assert np.interp(t, motion.t, motion.position) / step == pytest.approx(expected, abs=0.02)


def test_the_feed_forward_alone_gives_the_target_rate() -> None:
    craft = boat(1.0, 0.8, delta=0.0, delay=0.0)
    gains = {**ROVER_DEFAULTS, "ATC_STR_RAT_FF": 1.0 / 0.8, "ATC_STR_RAT_P": 0.0, "ATC_STR_RAT_I": 0.0}
    motion = TURN.simulate(craft, gains, Scenario(30.0 * DEG, 15.0), 1.0, 0.0)
    assert motion.position[0] == pytest.approx(0.0, abs=1e-6)
    assert motion.position[-1] == pytest.approx(30.0 * DEG, rel=1e-3)
    assert motion.output[-1] == pytest.approx(15.0 * DEG / 0.8, rel=1e-3)


def test_a_rover_with_yaw_lag_gets_a_better_turn_rate_step_and_keeps_its_angle_gain() -> None:
    axis = FIRMWARE["ardurover"].axes["yaw"]
    model = boat(1.0, 0.8)
    spec = Spec(step=30.0 * DEG, speed=2.0, step_duration=8.0, noise_std=0.002)
    proposal = design(model, uncertain(model), axis, ROVER_DEFAULTS, spec)
    assert is_better(proposal.before.metrics, proposal.after.metrics).better
    assert "ATC_STR_ANG_P" not in proposal.new
    assert proposal.worst_margins.stable


def test_rate_steps_of_a_sub_overshoot_to_recover_the_heading_error() -> None:
    """The area under the rate's error is what the heading target got ahead: it comes back, so the areas cancel."""
    craft = yaw(0.18, 0.1)
    gains = {**SUB_HEADING_DEFAULTS, "ATC_RAT_YAW_I": 0.0, "ATC_RAT_YAW_P": 0.5, "ATC_ANG_YAW_P": 3.0}
    motion = SUB_TURN.simulate(craft, gains, Scenario(30.0 * DEG, 12.0), None, 0.0)
    assert motion.position.max() > 1.1 * 30.0 * DEG
    behind = np.trapezoid(30.0 * DEG - motion.position, motion.t)
    standing = 2.0 * craft.beta * 15.0 * DEG / 0.5 / 3.0
    assert behind == pytest.approx(standing, abs=0.2 * standing)


def test_a_sub_gets_a_better_turn_rate_step_and_keeps_a_stable_heading_loop() -> None:
    axis = FIRMWARE["ardusub"].axes["yaw"]
    model = yaw(0.18, 0.0, 0.4, 0.01)
    spec = Spec(step=30.0 * DEG, step_duration=6.0, noise_std=0.002)
    proposal = design(model, uncertain(model), axis, SUB_HEADING_DEFAULTS, spec)
    assert is_better(proposal.before.metrics, proposal.after.metrics, SUB_TURN.free_overshoot).better
    assert proposal.new["ATC_ANG_YAW_P"] >= 1.0
    assert math.degrees(proposal.worst_margins.phase) >= 45.0


def test_a_boat_with_two_thrusters_is_not_scaled_with_speed_and_its_integral_acts_at_rest() -> None:
    law, gains = LAWS["rover-heading"], {**ROVER_DEFAULTS, "ATC_STR_RAT_P": 1.0}
    skid = {**gains, SKID: 1.0}
    once, again = (law.simulate(CHARLIE, skid, Scenario(0.2, 10.0), v, 0.0).position for v in (0.3, 5.0))
    assert np.array_equal(once, again)
    assert law.integral_rate(skid, 0.3) > 0.0
    assert math.isinf(law.integral_rate(gains, 0.3))
    assert any("skid steering" in note for note in law.notes(CHARLIE, skid, 1.0))
    rudder = law.simulate(CHARLIE, gains, Scenario(0.2, 10.0), 5.0, 0.0).position
    assert not np.allclose(rudder, again)


@pytest.mark.parametrize("name", ["rover-heading", "rover-yaw"])
def test_two_thrusters_under_way_have_less_steering_left(name: str) -> None:
    """Shared fairly: of full steering beside half throttle two thirds are left; of a fifth, all of it."""
    law, gains = LAWS[name], {**ROVER_DEFAULTS, "ATC_STR_RAT_P": 3.0, "ATC_STR_RAT_FF": 1.0, "ATC_STR_ANG_P": 4.0}
    still, driven, small = (
        law.simulate(CHARLIE, {**gains, SKID: 1.0, THROTTLE: t}, Scenario(step, 8.0), 1.0, 0.0)
        for t, step in ((0.0, 1.0), (0.5, 1.0), (0.5, 0.02))
    )
    assert np.max(np.abs(still.output)) == 1.0
    assert np.max(np.abs(driven.output)) == pytest.approx(2.0 / 3.0)
    free = law.simulate(CHARLIE, {**gains, SKID: 1.0}, Scenario(0.02, 8.0), 1.0, 0.0)
    assert np.array_equal(small.position, free.position)
    rudder = law.simulate(CHARLIE, {**gains, THROTTLE: 0.5}, Scenario(1.0, 8.0), 1.0, 0.0)
    assert np.max(np.abs(rudder.output)) == 1.0


def test_the_rate_loop_opened_at_the_servo_is_the_pid_with_the_gyro_filter() -> None:
    gains = {**ROVER_DEFAULTS, "ATC_STR_RAT_I": 0.0, "ATC_STR_RAT_FLTE": 0.0, "INS_GYRO_FILTER": 0.0}
    opened = TURN.controller(gains, 2.0)
    assert isinstance(opened, Rational)
    assert abs(opened.at(np.array([1j]))[0]) == pytest.approx(0.2 / 2.0)
