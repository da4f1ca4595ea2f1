"""A sub that rolls and pitches: the control by its autopilot, and its messages."""

from __future__ import annotations

import math

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sitl.autopilot.autopilot import StateEstimate
from sitl.sensors import SensorReading
from tests.sitl.ground import SUB_ALT_HOLD, SUB_MANUAL, SUB_STABILIZE, Ground, rov

NEUTRAL = {1: 1500, 2: 1500, 3: 1500, 4: 1500, 5: 1500, 6: 1500}


def sub(mode: int = SUB_STABILIZE, **options) -> Ground:
    ground = rov("bluerov2-6dof", mode=mode, **options)
    ground.sticks = NEUTRAL
    return ground


def test_attitude_messages_contain_the_true_roll_and_pitch():
    ground = sub(SUB_MANUAL)
    ground.stream(mavlink.MAVLINK_MSG_ID_ATTITUDE, 20)
    ground.sticks = {**NEUTRAL, 2: 1540}
    ground.run(1.5)
    at, reported = ground.vehicle.state, ground.last("ATTITUDE")
    assert at.phi > 0.1 and reported.rollspeed > 0.0
    assert reported.roll == pytest.approx(at.phi, abs=0.1)
    assert reported.pitch == pytest.approx(at.theta, abs=0.02)


def test_the_gyro_filter_delays_roll_and_pitch_rates_like_the_yaw_rate():
    estimate, reading = StateEstimate(sub().vehicle.parameters), SensorReading()
    estimate.update(reading, 0.0025)
    reading.p = reading.q = reading.r = 1.0
    for _ in range(4):
        estimate.update(reading, 0.0025)
    assert 0.1 < estimate.yaw_rate < 0.9
    assert estimate.roll_rate == estimate.pitch_rate == estimate.yaw_rate


@pytest.mark.parametrize(("channel", "angle"), [(2, "phi"), (1, "theta")])
def test_a_manual_stick_rolls_to_starboard_and_pitches_up(channel, angle):
    ground = sub(SUB_MANUAL)
    ground.sticks = {**NEUTRAL, channel: 1540}
    ground.run(1.0)
    other = "theta" if angle == "phi" else "phi"
    assert getattr(ground.vehicle.state, angle) > 0.02
    assert abs(getattr(ground.vehicle.state, other)) < 0.1 * getattr(ground.vehicle.state, angle)


def test_a_craft_without_roll_passes_the_roll_stick_to_its_motors():
    ground = rov("falcon", mode=SUB_MANUAL)
    ground.sticks = {**NEUTRAL, 2: 1600}
    ground.run(0.5)
    assert list(ground.vehicle.autopilot.pwm[4:6]) == [1600, 1400]
    assert ground.vehicle.state.phi == 0.0


def test_stabilize_rights_a_tilted_craft():
    ground = sub()
    at = ground.vehicle.state
    at.phi, at.theta = 0.6, -0.4
    ground.run(6.0)
    assert (at.phi, at.theta) == pytest.approx((0.0, 0.0), abs=0.08)  # within the dead zone


@pytest.mark.parametrize(("channel", "angle"), [(2, "phi"), (1, "theta")])
def test_stabilize_holds_the_angle_of_the_stick(channel, angle):
    ground = sub()
    ground.sticks = {**NEUTRAL, channel: 1700}
    ground.run(8.0)
    assert getattr(ground.vehicle.state, angle) == pytest.approx(math.radians(22.5), abs=math.radians(2.0))


def test_an_attitude_target_sets_roll_and_pitch_for_five_seconds():
    ground = sub(SUB_ALT_HOLD)
    half, c, s = 0.15, math.cos(0.15), math.sin(0.15)
    yaw = ground.vehicle.state.psi
    q = [c * math.cos(yaw / 2), s * math.cos(yaw / 2), s * math.sin(yaw / 2), c * math.sin(yaw / 2)]
    ground.repeated = lambda: mavlink.MAVLink_set_attitude_target_message(0, 1, 1, 7 | 64, q, 0, 0, 0, 0.5)
    ground.run(5.0)
    assert ground.vehicle.state.phi == pytest.approx(2.0 * half, abs=0.03)
    ground.repeated = None
    ground.run(10.0)
    assert ground.vehicle.state.phi == pytest.approx(0.0, abs=0.03)


def test_the_extensions_of_manual_control_are_pitch_and_roll():
    ground = sub(SUB_MANUAL)
    ground.sticks = None
    for extensions, expected in ((0, [1500, 1500]), (1, [1600, 1500]), (3, [1600, 1400])):
        ground.send(mavlink.MAVLink_manual_control_message(1, 0, 0, 500, 0, 0, 0, extensions, 500, -500))
        ground.run(0.1)
        assert ground.vehicle.autopilot.rc.pwm[1:3] == expected


def test_pid_tuning_has_the_roll_and_pitch_loops():
    ground = sub()
    ground.set("GCS_PID_MASK", 3.0)
    ground.stream(mavlink.MAVLINK_MSG_ID_PID_TUNING, 10)
    ground.vehicle.state.phi = 0.3
    ground.run(1.0)
    assert {message.axis for message in ground.all("PID_TUNING")} == {1, 2}


def test_a_level_sub_ignores_roll_sticks():
    ground = rov("bluerov2", mode=SUB_STABILIZE)
    ground.sticks = NEUTRAL
    ground.run(0.5)
    before = ground.servos[4:8]
    ground.sticks = {**NEUTRAL, 1: 1800, 2: 1800}
    ground.run(0.5)
    assert ground.servos[4:8] == before


def test_shaft_speeds_are_sent_as_esc_telemetry_and_rpm():
    ground = rov("ies-rov")
    for message in (mavlink.MAVLINK_MSG_ID_ESC_TELEMETRY_1_TO_4, mavlink.MAVLINK_MSG_ID_RPM):
        ground.stream(message, 10)
    ground.sticks = {**NEUTRAL, 5: 1700}
    ground.run(2.0)
    true = 60.0 * ground.vehicle.plant.rotors
    assert true[0] > 100.0
    assert ground.last("ESC_TELEMETRY_1_TO_4").rpm == pytest.approx(true, abs=20.0)
    assert ground.last("ESC_TELEMETRY_1_TO_4").voltage[0] == pytest.approx(1260, abs=40)
    assert (ground.last("RPM").rpm1, ground.last("RPM").rpm2) == pytest.approx(tuple(true[:2]), abs=20.0)


def test_a_craft_with_eight_thrusters_sends_two_messages_and_one_without_sends_none():
    ground = sub(SUB_MANUAL)
    ground.stream(mavlink.MAVLINK_MSG_ID_ESC_TELEMETRY_1_TO_4, 5)
    ground.run(1.0)
    assert ground.all("ESC_TELEMETRY_1_TO_4") and ground.all("ESC_TELEMETRY_5_TO_8")
    assert rov("bluerov2").stream(mavlink.MAVLINK_MSG_ID_RPM, 5) != 0
