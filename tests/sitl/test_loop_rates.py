"""The loop of each firmware runs at the real rate, and nothing else depends on it."""

from __future__ import annotations

import itertools
import math

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

import sitl

from .ground import SUB_ALT_HOLD, Ground

ATTITUDE = mavlink.MAVLINK_MSG_ID_ATTITUDE


@pytest.mark.parametrize(("name", "rate"), [("charlie", 50), ("bluerov2", 400), ("falcon", 400)])
def test_rover_runs_50_loops_a_second_and_sub_400(name: str, rate: int) -> None:
    server = sitl.open_vehicle(name)
    assert server.vehicle.parameters["SCHED_LOOP_RATE"] == server.vehicle.rate == rate
    server.advance_to(1.0)
    assert server.vehicle.tick == rate and server.vehicle.ms == 1000


@pytest.mark.parametrize(("asked", "runs"), [(20.0, 50), (49.0, 50), (199.0, 150), (200.0, 200), (5000.0, 1000)])
def test_a_loop_rate_set_before_boot_acts_in_whole_multiples_of_50(asked: float, runs: int) -> None:
    assert sitl.open_vehicle("falcon", parameters={"SCHED_LOOP_RATE": asked}).vehicle.rate == runs


def test_the_fastest_telemetry_follows_the_loop() -> None:
    rov, boat = Ground("bluerov2"), Ground("charlie")
    for ground, takes in ((rov, mavlink.MAV_RESULT_ACCEPTED), (boat, mavlink.MAV_RESULT_DENIED)):
        ground.run(0.5)
        assert ground.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, ATTITUDE, 5000.0) == takes
    stamps = [m.time_boot_ms for m in rov.run(0.5) if m.get_type() == "ATTITUDE"]
    assert len(stamps) >= 99
    assert {b - a for a, b in itertools.pairwise(stamps)} == {5}


def test_sensor_noise_changes_at_the_same_rate_for_every_loop_rate() -> None:
    for rate in (50.0, 400.0):
        vehicle = sitl.open_vehicle("bluerov2", seed=3, parameters={"SCHED_LOOP_RATE": rate}).vehicle
        drawn = set()
        for _ in range(int(rate)):
            vehicle.move()
            vehicle.control()
            drawn.add(round(vehicle._reading.r - vehicle.state.r, 12))
        assert 50 <= len(drawn) <= 51


def test_sticks_are_read_50_times_a_second_at_every_loop_rate() -> None:
    ground = Ground("bluerov2", parameters={"ARMING_CHECK": 0.0})
    ground.run(4.0)
    rc = ground.vehicle.autopilot.rc
    rc.override(4, 1600, ground.vehicle.ms)
    read_at = []
    for _ in range(16):
        ground.vehicle.move()
        ground.vehicle.control()
        if rc.pwm[4] == 1600:
            read_at.append(ground.vehicle.ms)
    assert read_at[0] % 20 == 0


def test_a_heading_step_is_the_same_at_every_loop_rate() -> None:
    """The loop is quicker, the hull is not: without a link the first half second of full thrust turns it as far."""
    turned = []
    for rate in (50.0, 400.0):
        parameters = {"SCHED_LOOP_RATE": rate, "FS_PILOT_INPUT": 0.0, "FS_GCS_ENABLE": 0.0, "ARMING_CHECK": 0.0}
        vehicle = sitl.open_vehicle("falcon", parameters=parameters).vehicle
        sub = vehicle.autopilot
        sub.arm(force=True)
        sub.rc.override(4, 1900, 0)
        for _ in range(int(rate)):
            vehicle.move()
            vehicle.control()
        turned.append(vehicle.state.r)
    assert turned[0] == pytest.approx(turned[1], rel=0.05)
    assert abs(turned[0]) > math.radians(10.0)


def test_alt_hold_is_held_at_400_hz() -> None:
    ground = Ground("bluerov2", parameters={"ARMING_CHECK": 0.0})
    ground.run(4.0)
    ground.command(mavlink.MAV_CMD_DO_SET_MODE, 1, SUB_ALT_HOLD)
    assert ground.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1) == mavlink.MAV_RESULT_ACCEPTED
    ground.sticks = {3: 1500, 4: 1500}
    depth = ground.vehicle.state.z
    ground.run(10.0)
    assert ground.vehicle.state.z == pytest.approx(depth, abs=0.1)
