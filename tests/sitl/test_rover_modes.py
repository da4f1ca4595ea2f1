"""Rover's output mapping and loops, against what was measured on the real firmware."""

from __future__ import annotations

import itertools
import math

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tests.sitl.ground import ACRO, GUIDED, HOLD, MANUAL, STEERING, Ground, boat


def _steady(sticks: dict[int, int], mode: int = MANUAL, seconds: float = 1.5) -> list[int]:
    ground = boat(mode=mode)
    ground.sticks = sticks
    ground.run(seconds)
    return ground.servos


@pytest.mark.parametrize(
    ("stick", "servo"),
    [
        (1500, 1500),
        (1530, 1500),
        (1470, 1500),
        (1550, 1521),
        (1700, 1680),
        (1750, 1734),
        (2000, 2000),
        (1450, 1479),
    ],
)
def test_manual_steering_has_the_measured_map(stick, servo):
    assert _steady({1: stick, 3: 1500})[0] == servo


@pytest.mark.parametrize(
    ("stick", "servo"),
    [
        (1500, 1500),
        (1530, 1500),
        (1550, 1520),
        (1700, 1680),
        (1750, 1730),
        (2000, 2000),
        (1000, 1000),
        (1300, 1320),
    ],
)
def test_manual_throttle_has_steps_of_one_percent(stick, servo):
    assert _steady({1: 1500, 3: stick})[2] == servo


def test_throttle_slews_one_hundred_percent_a_second():
    ground = boat()
    ground.stream(36, 40)
    ground.sticks = {1: 1500, 3: 2000}
    ground.run(0.5)
    assert ground.servos[2] == pytest.approx(1740, abs=20)
    ground.run(0.6)
    assert ground.servos[2] == 2000


def test_a_slew_rate_of_zero_disables_the_limit():
    ground = boat(parameters={"MOT_SLEWRATE": 0})
    ground.sticks = {1: 1500, 3: 2000}
    ground.run(0.1)
    assert ground.servos[2] == 2000


def test_steering_is_reversed_when_going_astern():
    assert _steady({1: 1700, 3: 1300})[0] == pytest.approx(1319, abs=1)


def test_a_reversed_stick_and_a_reversed_servo_are_supported():
    ground = boat(parameters={"RC1_REVERSED": 1, "SERVO3_REVERSED": 1})
    ground.sticks = {1: 1700, 3: 1700}
    ground.run(1.0)
    assert ground.servos[0] == pytest.approx(1319, abs=1)
    assert ground.servos[2] == 1320


def test_servo_end_points_take_effect_at_once():
    ground = boat()
    ground.sticks = {1: 2000, 3: 1500}
    ground.set("SERVO1_MAX", 1800)
    ground.run(0.1)
    assert ground.servos[0] == 1800


def test_a_servo_without_function_gives_no_pulse():
    ground = boat(parameters={"SERVO1_FUNCTION": 0})
    ground.run(0.1)
    assert ground.servos[0] == 0


def test_manual_control_steers_with_y_and_drives_with_z():
    ground = boat()
    ground.sticks = None
    for _ in range(15):
        ground.manual_control(x=999, y=400, z=500, r=-999)
        ground.run(0.1)
    assert ground.servos[0] == pytest.approx(1681, abs=1)
    assert ground.servos[2] == 1730


def test_manual_control_for_another_vehicle_is_ignored():
    ground = boat()
    ground.sticks = None
    ground.manual_control(y=1000, target=3)
    ground.run(0.1)
    assert ground.servos[0] == 1500


def test_sticks_from_the_wrong_system_are_ignored_silently():
    ground = boat()
    other = mavlink.MAVLink(None, srcSystem=42, srcComponent=190)
    message = mavlink.MAVLink_rc_channels_override_message(1, 1, 2000, 0, 2000, 0, 0, 0, 0, 0)
    ground.server.receive(message.pack(other))
    ground.run(0.1)
    assert ground.servos[0] == 1500


def test_hold_stops_the_engine_and_centres_the_rudder():
    ground = boat()
    ground.sticks = {1: 1900, 3: 1900}
    ground.run(2.0)
    ground.mode(HOLD)
    ground.run(1.5)
    assert (ground.servos[0], ground.servos[2]) == (1500, 1500)


def test_acro_turns_at_the_rate_of_the_stick():
    ground = boat(mode=ACRO, parameters={"ATC_STR_RAT_FF": 3, "ATC_STR_RAT_I": 1, "ACRO_TURN_RATE": 20})
    ground.sticks = {1: 1500 + 30 + 94, 3: 1950}
    ground.run(40.0)
    assert math.degrees(ground.vehicle.state.r) == pytest.approx(4.0, abs=0.4)
    assert ground.vehicle.state.u == pytest.approx(1.2 / 0.8 * 0.89, abs=0.05)


def test_steering_mode_turns_in_the_direction_of_the_stick():
    ground = boat(mode=STEERING, parameters={"ATC_STR_RAT_FF": 3})
    ground.sticks = {1: 1600, 3: 1900}
    ground.run(10.0)
    assert ground.vehicle.state.r > 0.03
    ground.sticks = {1: 1400, 3: 1900}
    ground.run(10.0)
    assert ground.vehicle.state.r < -0.03


def _guided(**parameters: float) -> Ground:
    ground = boat(mode=GUIDED, parameters={"ATC_STR_RAT_FF": 3, "ATC_STR_RAT_P": 2, "ATC_STR_ANG_P": 1, **parameters})
    ground.hold_heading(0.6)
    ground.run(25.0)
    return ground


def test_guided_follows_a_heading_step_at_the_target_speed():
    ground = _guided()
    assert ground.vehicle.state.u == pytest.approx(1.2, abs=0.03)
    ground.hold_heading(1.1)
    ground.run(40.0)
    assert math.degrees(ground.vehicle.state.psi) == pytest.approx(math.degrees(1.1), abs=2.0)


def test_guided_ignores_an_attitude_target_without_thrust():
    ground = boat(mode=GUIDED)
    ground.hold_heading(1.5)
    ground.repeated = lambda: mavlink.MAVLink_set_attitude_target_message(0, 1, 1, 71, [1, 0, 0, 0], 0, 0, 0, 1.0)
    ground.run(5.0)
    assert ground.servos[2] == 1500


def _velocity_target(mask: int, rate: float = 0.0, vx: float = 1.0):
    body_frame = 8
    return mavlink.MAVLink_set_position_target_local_ned_message(
        0, 1, 1, body_frame, mask, 0, 0, 0, vx, 0, 0, 0, 0, 0, 0, rate
    )


def _attitude_target(r: float):
    return mavlink.MAVLink_set_attitude_target_message(0, 1, 1, 3, [1, 0, 0, 0], 0, 0, r, 1.0)


@pytest.mark.parametrize(
    ("target", "r", "u"),
    [
        (lambda ground: ground.hold_heading(0.6, thrust=0.5), None, 0.6),
        (lambda ground: setattr(ground, "repeated", lambda: _attitude_target(0.08)), 0.08, None),
        (lambda ground: setattr(ground, "repeated", lambda: _velocity_target(0b010111000111, rate=-0.08)), -0.08, 1.0),
        (lambda ground: setattr(ground, "repeated", lambda: _velocity_target(0b110111000111)), None, 1.0),
    ],
    ids=["fraction of WP_SPEED", "turn rate", "velocity and turn rate", "velocity alone"],
)
def test_guided_follows_speeds_and_turn_rates(target, r, u):
    ground = _guided()
    target(ground)
    ground.run(40.0)
    if r is not None:
        assert ground.vehicle.state.r == pytest.approx(r, abs=0.015)
    if u is not None:
        assert ground.vehicle.state.u == pytest.approx(u, abs=0.05)


def test_an_acceleration_target_is_ignored():
    ground = boat(mode=GUIDED)
    ground.repeated = lambda: _velocity_target(0b010000000111)
    ground.run(5.0)
    assert ground.servos[2] == 1500


def test_guided_stops_three_seconds_after_the_last_target():
    ground = _guided()
    ground.repeated = None
    ground.run(2.8)
    assert ground.servos[2] > 1600
    ground.run(4.0)
    assert "target not received last 3secs, stopping" in ground.texts()
    assert ground.vehicle.state.u < 0.9


def test_a_loitering_boat_returns():
    ground = boat(mode=GUIDED)
    ground.run(1.0)
    ground.vehicle.state.x -= 30.0
    ground.run(3.0)
    assert ground.servos[2] > 1500


def test_above_the_base_speed_automatic_steering_is_scaled_down():
    ground = _guided()
    ground.hold_heading(0.65)
    ground.run(0.3)
    wanted = ground.vehicle.autopilot.motors.steering
    assert abs(wanted) < 1.0
    speed = ground.vehicle.autopilot.estimate.speed
    assert ground.servos[0] == pytest.approx(1500 + 500 * wanted / speed, abs=1)


def test_at_or_below_the_base_speed_the_integral_does_not_grow():
    ground = _guided(WP_SPEED=0.8)
    before = abs(ground.vehicle.autopilot.steering.pid.integrator)
    ground.hold_heading(0.9)
    ground.run(10.0)
    assert abs(ground.vehicle.autopilot.steering.pid.integrator) <= before


def test_above_the_base_speed_the_integral_grows():
    ground = _guided()
    before = ground.vehicle.autopilot.steering.pid.integrator
    ground.hold_heading(0.9)
    ground.run(4.0)
    assert ground.vehicle.autopilot.steering.pid.integrator > before + 0.01


def test_the_reported_yaw_rate_lags_by_the_gyro_filter():
    ground = boat()
    ground.stream(30, 40)
    ground.sticks = {1: 1500, 3: 2000}
    ground.run(10.0)
    filtered, true = [], []
    for step in range(120):
        ground.sticks = {1: 2000 if step % 40 < 20 else 1000, 3: 2000}
        ground.run(0.1)
        filtered.append(ground.vehicle.autopilot.estimate.yaw_rate)
        true.append(ground.vehicle.state.r)
    slope = [(b - a) / 0.1 for a, b in itertools.pairwise(true)]
    lag = sum((t - f) * s for t, f, s in zip(true[1:], filtered[1:], slope, strict=True)) / sum(s * s for s in slope)
    assert lag == pytest.approx(0.056, abs=0.015)
