from __future__ import annotations

import itertools
import math

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tests.sitl.ground import Ground, boat, rov

ATTITUDE, SERVO, PRESSURE, PID = 30, 36, 137, 194
ACCEPTED, DENIED = 0, 2


def _stamps(ground: Ground, seconds: float, kind: str = "ATTITUDE") -> list[int]:
    return [m.time_boot_ms for m in ground.run(seconds) if m.get_type() == kind]


def test_ten_hertz_falls_on_whole_tenths():
    ground = Ground("charlie")
    ground.run(0.33)
    assert ground.stream(ATTITUDE, 10) == ACCEPTED
    stamps = _stamps(ground, 2.0)
    assert len(stamps) == 20
    assert all(stamp % 100 == 0 for stamp in stamps)


def test_forty_hertz_alternates_between_one_and_two_loops():
    ground = Ground("charlie")
    assert ground.stream(ATTITUDE, 40) == ACCEPTED
    stamps = _stamps(ground, 2.0)
    assert 79 <= len(stamps) <= 81
    assert {b - a for a, b in itertools.pairwise(stamps)} == {20, 40}


def test_faster_than_the_loop_allows_is_denied_and_the_old_rate_stays():
    ground = Ground("charlie")
    ground.stream(ATTITUDE, 10)
    assert ground.stream(ATTITUDE, 50) == DENIED
    assert any("too fast" in text for text in ground.texts())
    assert len(_stamps(ground, 1.0)) == 10


def test_all_messages_together_run_at_forty_hertz():
    ground = Ground("charlie")
    kinds = {
        30: "ATTITUDE",
        74: "VFR_HUD",
        33: "GLOBAL_POSITION_INT",
        32: "LOCAL_POSITION_NED",
        36: "SERVO_OUTPUT_RAW",
    }
    for number in kinds:
        assert ground.stream(number, 40) == ACCEPTED
    heard = [m.get_type() for m in ground.run(2.0)]
    for kind in kinds.values():
        assert 79 <= heard.count(kind) <= 81


def test_a_stream_is_switched_off_and_reset_to_its_default():
    ground = Ground("charlie")
    ground.command(511, ATTITUDE, -1)
    assert _stamps(ground, 2.0) == []
    ground.command(511, ATTITUDE, 0)
    assert len(_stamps(ground, 2.0)) == 4


def test_an_unknown_message_is_denied():
    ground = Ground("charlie")
    assert ground.stream(251, 1) == DENIED
    assert "No ap_message for mavlink id (251)" in ground.texts()


def test_the_interval_can_be_requested():
    ground = Ground("charlie")
    ground.stream(SERVO, 40)
    ground.command(510, SERVO)
    interval = ground.last("MESSAGE_INTERVAL")
    assert (interval.message_id, interval.interval_us) == (SERVO, 25000)


def test_the_old_stream_request_is_supported():
    ground = Ground("charlie")
    ground.send(mavlink.MAVLink_request_data_stream_message(1, 1, mavlink.MAV_DATA_STREAM_EXTRA1, 20, 1))
    ground.run(0.1)
    assert len(_stamps(ground, 1.0)) == 20
    ground.send(mavlink.MAVLink_request_data_stream_message(1, 1, mavlink.MAV_DATA_STREAM_ALL, 20, 0))
    ground.run(0.1)
    assert _stamps(ground, 1.0) == []


def test_stamps_are_boot_time_and_servo_stamps_microseconds():
    ground = Ground("charlie")
    ground.stream(SERVO, 10)
    ground.run(1.0)
    assert ground.last("SERVO_OUTPUT_RAW").time_usec % 100_000 == 0
    assert abs(ground.last("SERVO_OUTPUT_RAW").time_usec / 1e6 - ground.t) < 0.1


def test_position_and_speed_agree_with_the_hull():
    ground = boat()
    for number in (32, 33, 74):
        ground.stream(number, 10)
    ground.sticks = {1: 1500, 3: 2000}
    ground.run(20.0)
    body = ground.vehicle.state
    local, glob, hud = (ground.last(k) for k in ("LOCAL_POSITION_NED", "GLOBAL_POSITION_INT", "VFR_HUD"))
    assert (local.x, local.y) == pytest.approx((body.x, body.y), abs=0.2)
    assert hud.groundspeed == pytest.approx(1.5, abs=0.1)
    assert hud.throttle == 100
    assert glob.hdg / 100 == pytest.approx(math.degrees(body.psi) % 360, abs=2)
    north = (glob.lat / 1e7 - 44.4250) * 111319.5
    assert north == pytest.approx(body.x, abs=0.2)


def test_depth_is_negative_altitude_and_growing_pressure():
    ground = rov("falcon")
    for number in (33, 32, PRESSURE):
        ground.stream(number, 10)
    ground.run(0.5)
    depth = ground.vehicle.state.z
    assert ground.last("GLOBAL_POSITION_INT").relative_alt == pytest.approx(-1000 * depth, abs=40)
    assert ground.last("LOCAL_POSITION_NED").z == pytest.approx(depth, abs=0.04)
    assert ground.last("SCALED_PRESSURE2").press_abs == pytest.approx(1013.25 + 98.0665 * depth, abs=4)


def test_the_battery_is_shown_and_can_be_lowered():
    ground = Ground("charlie")
    ground.run(1.5)
    assert ground.last("SYS_STATUS").voltage_battery == pytest.approx(12592, abs=10)
    assert ground.last("SYS_STATUS").battery_remaining >= 99
    ground.set("SIM_BATT_VOLTAGE", 10.0)
    ground.run(1.5)
    assert ground.last("SYS_STATUS").voltage_battery < 10000


def test_a_battery_under_load_is_discharged():
    ground = boat(parameters={"BATT_CAPACITY": 100})
    ground.sticks = {1: 1500, 3: 2000}
    ground.run(30.0)
    assert 30 < ground.last("SYS_STATUS").battery_remaining < 70


def test_rc_channels_show_the_overrides():
    ground = boat()
    ground.stream(65, 10)
    ground.sticks = {1: 1600, 3: 1500}
    ground.run(0.5)
    assert ground.last("RC_CHANNELS").chan1_raw == 1600


def test_pid_tuning_shows_the_steering_loop_in_its_units():
    ground = boat(mode=15, parameters={"GCS_PID_MASK": 1})
    ground.stream(PID, 10)
    ground.hold_heading(1.2)
    ground.run(3.0)
    tuning = ground.last("PID_TUNING")
    assert tuning.axis == 5
    assert tuning.desired > 5.0
    assert pytest.approx(0.2 * math.radians(tuning.desired), rel=1e-4) == tuning.FF
    assert tuning.achieved == pytest.approx(math.degrees(ground.vehicle.state.r), abs=1.5)


def test_each_set_bit_gives_one_pid_tuning_message():
    ground = boat(mode=15, parameters={"GCS_PID_MASK": 3})
    ground.stream(PID, 10)
    assert sorted(m.axis for m in ground.run(1.0) if m.get_type() == "PID_TUNING") == [4] * 10 + [5] * 10


def test_subs_pid_tuning_keeps_the_firmwares_odd_scale():
    ground = rov(mode=2, parameters={"GCS_PID_MASK": 12})
    ground.stream(PID, 10)
    ground.hold_heading(1.2)
    ground.run(1.0)
    yaw = next(m for m in reversed(ground.heard) if m.get_type() == "PID_TUNING" and m.axis == 3)
    assert 0.0 < yaw.desired < 0.02
    assert pytest.approx(0.01 * ground.vehicle.autopilot.yaw.pid.p_part, abs=1e-3) == yaw.P
    assert 4 in {m.axis for m in ground.all("PID_TUNING")}


def test_link_delays_are_a_tenth_of_a_second_each_way():
    ground = Ground("videoray")
    ground.run(1.0)
    ground.send(mavlink.MAVLink_timesync_message(0, 1))
    heard = ground.run(0.18)
    assert not [m for m in heard if m.get_type() == "TIMESYNC"]
    (reply,) = [m for m in ground.run(0.04) if m.get_type() == "TIMESYNC"]
    assert reply.tc1 == 1_100_000_000
