"""Sub holds a position (POSHOLD) and goes to another one (GUIDED)."""

from __future__ import annotations

import math

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sitl.place import to_globe
from tests.sitl.ground import SUB_ALT_HOLD, SUB_GUIDED, SUB_MANUAL, Ground, rov
from tests.sitl.missions import place, upload, waypoint

POSHOLD = 16
ONLY_PLACE, ONLY_DEPTH = 0b110111111000, 0b110111111011
RELATIVE = mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT


def _holding(mode: int = POSHOLD, **options: object) -> Ground:
    ground = rov("bluerov2-sway", mode=mode, parameters={"WPNAV_SPEED": 50.0, **options})
    ground.vehicle.state.z = 4.0
    ground.run(0.1)
    ground.mode(SUB_MANUAL)
    ground.mode(mode)
    ground.run(1.0)
    return ground


def _go(ground: Ground, target: complex, altitude: float, mask: int = ONLY_PLACE) -> None:
    ground.send(
        mavlink.MAVLink_set_position_target_global_int_message(
            0, 1, 1, RELATIVE, mask, *to_globe(target), altitude, 0, 0, 0, 0, 0, 0, 0, 0
        )
    )


def test_poshold_holds_a_position_in_a_current():
    ground = _holding()
    here = place(ground)
    ground.vehicle.plant.water.V_x, ground.vehicle.plant.water.V_y = 0.12, -0.08
    ground.run(60.0)
    assert abs(place(ground) - here) < 0.15
    assert ground.vehicle.state.z == pytest.approx(4.0, abs=0.2)


def test_alt_hold_drifts_in_a_current():
    ground = _holding(mode=SUB_ALT_HOLD)
    here = place(ground)
    ground.vehicle.plant.water.V_x = 0.12
    ground.run(30.0)
    assert abs(place(ground) - here) > 2.0


@pytest.mark.parametrize(("channel", "turn"), [(5, 0.0), (6, 0.5 * math.pi)])
def test_a_stick_moves_the_held_position(channel, turn):
    ground = _holding()
    here = place(ground)
    ground.sticks[channel] = 1700
    ground.run(4.0)
    ground.sticks[channel] = 1500
    ground.run(1.0)
    there = place(ground)
    direction = math.remainder(math.atan2((there - here).imag, (there - here).real) - turn, math.tau)
    assert abs(there - here) > 0.3
    assert direction == pytest.approx(ground.vehicle.state.psi, abs=0.3)
    ground.run(15.0)
    assert abs(place(ground) - there) < 0.6


def test_poshold_turns_with_the_yaw_stick_and_stays():
    ground = _holding()
    here, heading = place(ground), ground.vehicle.state.psi
    ground.sticks[4] = 1600
    ground.run(3.0)
    ground.sticks[4] = 1500
    ground.run(10.0)
    assert abs(ground.vehicle.state.psi - heading) > 0.5
    assert abs(place(ground) - here) < 0.3


def test_poshold_needs_a_position():
    ground = Ground("bluerov2-sway", parameters={"ARMING_CHECK": 0})
    ground.sticks = {3: 1500, 4: 1500, 5: 1500, 6: 1500}
    ground.run(0.2)
    assert ground.command(400, 1, 21196) == 0
    assert ground.mode(POSHOLD) == mavlink.MAV_RESULT_FAILED


def test_guided_goes_to_position_and_depth_on_a_straight_line_and_stays():
    ground = _holding(mode=SUB_GUIDED)
    _go(ground, 5 + 3j, -5.0)
    offside = 0.0
    for _ in range(40):
        ground.run(1.0)
        offside = max(offside, abs((place(ground) / (5 + 3j)).imag) * abs(5 + 3j))
        depth = 4.0 + min((place(ground) / (5 + 3j)).real, 1.0)
        assert ground.vehicle.state.z == pytest.approx(depth, abs=0.25)
    assert offside < 0.2
    ground.run(30.0)
    assert abs(place(ground) - (5 + 3j)) < 0.1
    assert ground.vehicle.state.z == pytest.approx(5.0, abs=0.1)


def test_guided_keeps_to_the_speed_limit():
    ground = _holding(mode=SUB_GUIDED, WPNAV_SPEED=20.0)
    _go(ground, 8 + 0j, -4.0)
    fastest = 0.0
    for _ in range(40):
        before = place(ground)
        ground.run(1.0)
        fastest = max(fastest, abs(place(ground) - before))
    assert 0.15 < fastest < 0.25


def test_guided_without_a_target_holds_its_position():
    ground = _holding(mode=SUB_GUIDED)
    here = place(ground)
    ground.vehicle.plant.water.V_x = 0.12
    ground.run(60.0)
    assert abs(place(ground) - here) < 0.15


def test_a_new_target_replaces_the_old_one_at_once():
    ground = _holding(mode=SUB_GUIDED)
    _go(ground, 6 + 0j, -4.0)
    ground.run(6.0)
    _go(ground, 0 + 4j, -4.0)
    ground.run(60.0)
    assert abs(place(ground) - 4j) < 0.15


@pytest.mark.parametrize("frame", [mavlink.MAV_FRAME_LOCAL_NED, mavlink.MAV_FRAME_LOCAL_OFFSET_NED])
def test_a_local_position_target_is_supported(frame):
    ground = _holding(mode=SUB_GUIDED)
    ground.vehicle.state.x = 2.0
    ground.run(0.2)
    ground.mode(SUB_MANUAL)
    ground.mode(SUB_GUIDED)
    deeper = 1.0 if frame == mavlink.MAV_FRAME_LOCAL_OFFSET_NED else 5.0
    ground.send(
        mavlink.MAVLink_set_position_target_local_ned_message(0, 1, 1, frame, ONLY_PLACE, 3.0, 1.0, deeper, *[0] * 8)
    )
    ground.run(60.0)
    wanted = 5 + 1j if frame == mavlink.MAV_FRAME_LOCAL_OFFSET_NED else 3 + 1j
    assert abs(place(ground) - wanted) < 0.15
    assert ground.vehicle.state.z == pytest.approx(5.0, abs=0.15)


def test_a_depth_target_keeps_the_horizontal_position():
    ground = _holding(mode=SUB_GUIDED)
    here = place(ground)
    _go(ground, 20 + 20j, -5.0, ONLY_DEPTH)
    ground.run(30.0)
    assert abs(place(ground) - here) < 0.2
    assert ground.vehicle.state.z == pytest.approx(5.0, abs=0.15)


def test_a_position_target_in_alt_hold_is_ignored():
    ground = _holding(mode=SUB_ALT_HOLD)
    here = place(ground)
    _go(ground, 5 + 0j, -4.0)
    ground.run(10.0)
    assert abs(place(ground) - here) < 0.2


def test_telemetry_shows_target_and_distance():
    ground = _holding(mode=SUB_GUIDED)
    _go(ground, 5 + 0j, -4.0)
    ground.run(2.0)
    target = ground.last("POSITION_TARGET_GLOBAL_INT")
    assert (target.lat_int, target.lon_int) == to_globe(5 + 0j)
    assert ground.last("NAV_CONTROLLER_OUTPUT").wp_dist in (4, 5)


@pytest.mark.parametrize("names", ["own", "4.7"])
def test_both_names_of_the_gains_take_effect(names):
    gain = "PSC_POSXY_P" if names == "own" else "PSC_NE_POS_P"
    ground = rov("bluerov2-sway", names=names)
    ground.set(gain, 1.7)
    ground.run(0.2)
    assert ground.last("PARAM_VALUE").param_id == gain
    assert ground.vehicle.autopilot.position.gain == pytest.approx(1.7)


def test_sub_stores_a_mission_but_has_no_auto():
    ground = rov()
    assert upload(ground, [waypoint(5 + 0j)]) == mavlink.MAV_MISSION_ACCEPTED
    assert ground.mode(3) == mavlink.MAV_RESULT_FAILED
    assert ground.command(mavlink.MAV_CMD_MISSION_START) == mavlink.MAV_RESULT_UNSUPPORTED


def test_disarming_in_poshold_ends_every_output():
    ground = _holding()
    ground.vehicle.plant.water.V_x = 0.12
    ground.run(20.0)
    ground.command(400, 0)
    ground.run(0.1)
    assert set(ground.servos[:6]) == {1500}


def _stay(ground: Ground, target: complex, altitude: float, yaw: float) -> None:
    frame, place_and_yaw = mavlink.MAV_FRAME_LOCAL_NED, 0b100111000000
    way = (target.real, target.imag, -altitude)
    ground.send(
        mavlink.MAVLink_set_position_target_local_ned_message(
            0, 1, 1, frame, place_and_yaw, *way, 0, 0, 0, 0, 0, 0, yaw, 0
        )
    )


def test_guided_holds_a_repeated_position_with_the_commanded_heading():
    ground = _holding(mode=SUB_GUIDED)
    here, heading = place(ground), ground.vehicle.state.psi
    for _ in range(150):
        _stay(ground, here + 1 - 1j, -4.0, heading + 0.3)
        ground.run(0.1)
    assert abs(place(ground) - here - (1 - 1j)) < 0.15
    assert ground.vehicle.state.psi == pytest.approx(heading + 0.3, abs=0.05)
    assert ground.vehicle.state.z == pytest.approx(4.0, abs=0.2)


def test_a_stick_within_a_tenth_pushes_without_moving_the_held_position():
    ground = _holding()
    ground.run(10.0)
    here = place(ground)
    ground.sticks[5] = 1536
    ground.run(2.0)
    assert 0.02 < abs(place(ground) - here) < 0.4
    ground.run(40.0)
    assert abs(place(ground) - here) < 0.1
