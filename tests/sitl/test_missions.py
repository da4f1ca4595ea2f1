"""Missions over MAVLink: upload, rejection, storage, telemetry and flight."""

from __future__ import annotations

import math

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tests.sitl.ground import HOLD, MANUAL, Ground, boat
from tests.sitl.missions import (
    AUTO,
    CHANGE_SPEED,
    LOITER_TIME,
    LOITER_UNLIMITED,
    RETURN,
    RTL,
    item,
    place,
    run_until_reached,
    sailing,
    send,
    speed,
    step,
    twin,
    upload,
    waypoint,
)

TRIANGLE = [waypoint(15 + 0j), waypoint(15 + 15j), waypoint(0j)]


def _download(ground: Ground) -> list:
    ground.send(mavlink.MAVLink_mission_request_list_message(1, 1, 0))
    ground.run(0.1)
    for seq in range(ground.last("MISSION_COUNT").count):
        ground.send(mavlink.MAVLink_mission_request_int_message(1, 1, seq, 0))
        ground.run(0.1)
    return ground.all("MISSION_ITEM_INT")


def test_a_mission_is_downloaded_as_it_was_uploaded():
    ground = boat()
    ground.run(2.0)
    steps = [waypoint(15 + 5j, 3.0), step(CHANGE_SPEED, None, (1, 0.7, -1, 0)), step(LOITER_UNLIMITED, 9j)]
    assert upload(ground, steps) == mavlink.MAV_MISSION_ACCEPTED
    got = _download(ground)
    assert [m.seq for m in got] == [0, 1, 2, 3]
    for message, sent in zip(got[1:], [item(k, what) for k, what in enumerate(steps, start=1)], strict=True):
        for name in ("command", "param1", "param2", "param3", "x", "y", "z"):
            assert getattr(message, name) == pytest.approx(getattr(sent, name)), name


def test_item_0_is_home_where_the_boat_was_armed():
    ground = boat()
    ground.run(2.0)
    upload(ground, [waypoint(15 + 0j)])
    home = _download(ground)[0]
    position = ground.last("GLOBAL_POSITION_INT")
    assert home.command == 16
    assert home.x == pytest.approx(position.lat, abs=30) and home.y == pytest.approx(position.lon, abs=30)


def test_mission_items_of_the_old_message_are_supported_both_ways():
    ground = boat()
    ground.send(mavlink.MAVLink_mission_count_message(1, 1, 2, 0))
    for seq in range(2):
        ground.run(0.1)
        x, y = 44.4252, 8.7641
        ground.send(mavlink.MAVLink_mission_item_message(1, 1, seq, 3, 16, 0, 1, 0, 0, 0, 0, x, y, 0.0, 0))
    ground.run(0.1)
    assert ground.last("MISSION_ACK").type == mavlink.MAV_MISSION_ACCEPTED
    ground.send(mavlink.MAVLink_mission_request_message(1, 1, 1, 0))
    ground.run(0.1)
    assert ground.last("MISSION_ITEM").x == pytest.approx(44.4252, abs=1e-5)


BAD = {
    "an unknown command": (item(1, step(31000)), mavlink.MAV_MISSION_UNSUPPORTED),
    "a reserved command": (item(1, step(1)), mavlink.MAV_MISSION_INVALID),
    "a frame that is none": (item(1, waypoint(9j), frame=77), mavlink.MAV_MISSION_UNSUPPORTED_FRAME),
    "an endless wait": (item(1, waypoint(9j, math.inf)), mavlink.MAV_MISSION_INVALID_PARAM1),
    "no speed": (item(1, step(CHANGE_SPEED, None, (0, math.nan, 0, 0))), mavlink.MAV_MISSION_INVALID_PARAM2),
}


@pytest.mark.parametrize("name", BAD)
def test_a_bad_item_is_rejected_and_the_old_mission_is_kept(name):
    message, result = BAD[name]
    ground = boat()
    upload(ground, TRIANGLE)
    before = ground.vehicle.autopilot.mission.items
    assert send(ground, [item(0, waypoint(0j)), message, item(2, waypoint(0j))]) == result
    assert ground.vehicle.autopilot.mission.items == before


def test_a_latitude_beyond_the_pole_is_rejected():
    ground = boat()
    wrong = item(1, waypoint(9j))
    wrong.x = 910_000_000
    assert send(ground, [item(0, waypoint(0j)), wrong]) == mavlink.MAV_MISSION_INVALID_PARAM5_X


def test_a_waypoint_without_a_heading_is_allowed():
    ground = boat()
    free = item(1, (16, 9j, (0.0, 0.0, 0.0, math.nan)))
    assert send(ground, [item(0, waypoint(0j)), free]) == mavlink.MAV_MISSION_ACCEPTED


def test_too_many_items_are_rejected():
    ground = boat()
    ground.send(mavlink.MAVLink_mission_count_message(1, 1, 5000, 0))
    ground.run(0.1)
    assert ground.last("MISSION_ACK").type == mavlink.MAV_MISSION_NO_SPACE
    assert "Only 724 items are supported" in ground.texts()


def test_an_item_out_of_sequence_is_rejected_and_the_upload_continues():
    ground = boat()
    ground.send(mavlink.MAVLink_mission_count_message(1, 1, 2, 0))
    ground.run(0.1)
    ground.send(item(1, waypoint(9j)))
    ground.run(0.1)
    assert ground.last("MISSION_ACK").type == mavlink.MAV_MISSION_INVALID_SEQUENCE
    for seq in range(2):
        ground.send(item(seq, waypoint(9j)))
        ground.run(0.1)
    assert ground.last("MISSION_ACK").type == mavlink.MAV_MISSION_ACCEPTED


def test_an_interrupted_upload_keeps_the_old_mission():
    ground = boat()
    upload(ground, TRIANGLE)
    before = ground.vehicle.autopilot.mission.items
    ground.send(mavlink.MAVLink_mission_count_message(1, 1, 3, 0))
    ground.run(0.1)
    ground.send(item(0, waypoint(0j)))
    ground.run(5.0)
    assert [m.seq for m in ground.all("MISSION_REQUEST")][-3:] == [1, 1, 1]
    ground.run(5.0)
    assert ground.last("MISSION_ACK").type == mavlink.MAV_MISSION_OPERATION_CANCELLED
    assert "Mission upload timeout" in ground.texts()
    assert ground.vehicle.autopilot.mission.items == before


def test_another_station_is_denied_during_an_upload():
    ground = boat()
    ground.send(mavlink.MAVLink_mission_count_message(1, 1, 3, 0))
    ground.run(0.1)
    other = mavlink.MAVLink(None, srcSystem=42, srcComponent=190)
    for message in (
        mavlink.MAVLink_mission_count_message(1, 1, 2, 0),
        mavlink.MAVLink_mission_clear_all_message(1, 1, 0),
        mavlink.MAVLink_mission_request_list_message(1, 1, 0),
    ):
        ground.server.receive(message.pack(other))
        ground.run(0.1)
        ack = ground.last("MISSION_ACK")
        assert (ack.target_system, ack.type) == (42, mavlink.MAV_MISSION_DENIED)
    assert len(ground.all("MISSION_ACK")) == 3


def test_a_mission_is_cleared_unless_it_is_running():
    ground = sailing(TRIANGLE)
    ground.run(1.0)
    ground.send(mavlink.MAVLink_mission_clear_all_message(1, 1, 0))
    ground.run(0.1)
    assert ground.last("MISSION_ACK").type == mavlink.MAV_MISSION_ERROR
    ground.mode(MANUAL)
    ground.send(mavlink.MAVLink_mission_clear_all_message(1, 1, 0))
    ground.run(1.5)
    assert ground.last("MISSION_ACK").type == mavlink.MAV_MISSION_ACCEPTED
    assert ground.last("MISSION_CURRENT").mission_state == mavlink.MISSION_STATE_NO_MISSION


def test_a_mission_survives_a_reboot():
    ground = boat(armed=False)
    upload(ground, TRIANGLE)
    before = ground.vehicle.autopilot.mission.items
    ground.command(246, 1)
    ground.run(1.0)
    assert ground.vehicle.autopilot.mission.items == before


def test_auto_without_a_mission_is_rejected():
    ground = boat()
    assert ground.mode(AUTO) == mavlink.MAV_RESULT_FAILED
    assert ground.mode_number == MANUAL
    ground.run(0.1)
    assert "No Mission. Can't set AUTO." in ground.texts()


def test_a_boat_flies_its_mission_and_stops_at_the_last_waypoint():
    ground = sailing(TRIANGLE)
    for seq, corner in ((1, 15 + 0j), (2, 15 + 15j), (3, 0j)):
        run_until_reached(ground, seq)
        assert abs(place(ground) - corner) < 8.0
    assert "Mission Complete" in ground.texts()
    ground.run(15.0)
    assert ground.last("MISSION_CURRENT").mission_state == mavlink.MISSION_STATE_COMPLETE
    assert ground.mode_number == AUTO
    assert speed(ground) < 0.15 and ground.servos[2] == 1500
    assert abs(place(ground)) < 5.0


def test_the_corner_is_rounded_without_stopping():
    ground = sailing([waypoint(15 + 0j), waypoint(30 + 10j), waypoint(50 + 10j)])
    run_until_reached(ground, 1)
    ground.run(2.0)
    assert speed(ground) > 0.9


def test_telemetry_shows_target_and_distance():
    ground = sailing([waypoint(40 + 0j)])
    ground.run(6.0)
    way, target = ground.last("NAV_CONTROLLER_OUTPUT"), ground.last("POSITION_TARGET_GLOBAL_INT")
    assert way.wp_dist == pytest.approx(abs(40.0 - place(ground)), abs=1.5)
    sent = item(1, waypoint(40 + 0j))
    assert (target.lat_int, target.lon_int) == (sent.x, sent.y)
    current = ground.last("MISSION_CURRENT")
    assert (current.seq, current.total, current.mission_state, current.mission_mode) == (1, 1, 3, 1)
    ground.mode(MANUAL)
    ground.heard.clear()
    ground.run(3.0)
    assert not ground.all("NAV_CONTROLLER_OUTPUT") and not ground.all("POSITION_TARGET_GLOBAL_INT")
    assert ground.last("MISSION_CURRENT").mission_state == mavlink.MISSION_STATE_NOT_STARTED


def test_the_cross_track_error_is_positive_to_port():
    ground = sailing([waypoint(40 + 0j)])
    ground.run(4.0)
    ground.vehicle.state.y = 6.0
    ground.run(1.1)
    assert ground.last("NAV_CONTROLLER_OUTPUT").xtrack_error < -3.0


def test_a_delay_at_a_waypoint_is_observed():
    ground = sailing([waypoint(12 + 0j, 5.0), waypoint(0j)])
    reached = run_until_reached(ground, 1)
    assert "Reached waypoint #1. Loiter for 5 seconds" in ground.texts()
    reported = next(k for k, m in enumerate(ground.heard) if "Loiter for 5" in getattr(m, "text", ""))
    arrived = next(m.time_boot_ms for m in reversed(ground.heard[:reported]) if m.get_type() == "ATTITUDE")
    assert reached - arrived / 1000.0 == pytest.approx(5.0, abs=1.0)


@pytest.mark.parametrize("command", [LOITER_UNLIMITED, LOITER_TIME])
def test_a_boat_loiters_for_the_commanded_time(command):
    ground = sailing([step(command, 12 + 0j, (4.0, 0.0, 0.0, 0.0)), waypoint(0j)])
    ground.run(60.0)
    if command == LOITER_TIME:
        run_until_reached(ground, 2)
    else:
        assert not ground.all("MISSION_ITEM_REACHED")
        assert abs(place(ground) - 12.0) < 5.0 and ground.last("MISSION_CURRENT").seq == 1


def test_a_mission_can_end_with_a_return():
    ground = sailing([waypoint(15 + 10j), step(RETURN)])
    run_until_reached(ground, 2)
    assert abs(place(ground)) < 6.0 and "Mission Complete" in ground.texts()


def test_the_speed_changes_between_two_waypoints():
    ground = sailing([waypoint(12 + 0j), step(CHANGE_SPEED, None, (1.0, 0.6, -1.0, 0.0)), waypoint(90 + 0j)])
    run_until_reached(ground, 2)
    assert "speed: 0.6 m/s" in ground.texts()
    ground.run(50.0)
    assert speed(ground) == pytest.approx(0.6, abs=0.08)


def test_a_speed_command_before_the_first_waypoint_has_no_effect():
    ground = sailing([step(CHANGE_SPEED, None, (1.0, 0.6, -1.0, 0.0)), waypoint(60 + 0j)])
    ground.run(15.0)
    assert speed(ground) == pytest.approx(1.2, abs=0.1)


def test_the_station_changes_the_speed_during_a_mission():
    ground = sailing([waypoint(90 + 0j)])
    ground.run(15.0)
    assert ground.command(mavlink.MAV_CMD_DO_CHANGE_SPEED, 1, 0.7) == mavlink.MAV_RESULT_ACCEPTED
    ground.run(50.0)
    assert speed(ground) == pytest.approx(0.7, abs=0.08)
    assert ground.command(mavlink.MAV_CMD_DO_CHANGE_SPEED, 1, -1.0) == mavlink.MAV_RESULT_FAILED


def test_a_throttle_stick_above_the_speed_limit_raises_the_speed():
    ground = sailing([waypoint(100 + 0j)], parameters={"WP_SPEED": 0.8})
    ground.run(15.0)
    assert speed(ground) == pytest.approx(0.8, abs=0.06)
    ground.sticks = {1: 1500, 3: 1900}
    ground.run(15.0)
    assert speed(ground) > 1.1


def test_the_station_skips_to_another_item():
    ground = sailing(TRIANGLE)
    ground.run(2.0)
    ground.send(mavlink.MAVLink_mission_set_current_message(1, 1, 3))
    ground.run(0.2)
    assert ground.last("MISSION_CURRENT").seq == 3
    assert ground.command(mavlink.MAV_CMD_DO_SET_MISSION_CURRENT, 2) == mavlink.MAV_RESULT_ACCEPTED
    assert ground.command(mavlink.MAV_CMD_DO_SET_MISSION_CURRENT, 9) == mavlink.MAV_RESULT_FAILED
    ground.run(1.5)
    assert ground.last("MISSION_CURRENT").seq == 2


def test_a_skip_is_confirmed_with_the_number_that_was_sent():
    ground = boat()
    upload(ground, [waypoint(15 + 0j), step(CHANGE_SPEED, None, (1.0, 0.6, -1.0, 0.0)), waypoint(0j)])
    ground.heard.clear()
    ground.send(mavlink.MAVLink_mission_set_current_message(1, 1, 2))
    ground.run(0.1)
    assert ground.all("MISSION_CURRENT")[0].seq == 2
    ground.run(1.5)
    assert ground.last("MISSION_CURRENT").seq == 3


def test_the_mission_resumes_where_it_was_interrupted():
    ground = sailing(TRIANGLE)
    run_until_reached(ground, 1)
    ground.run(3.0)
    ground.mode(HOLD)
    ground.run(3.0)
    ground.mode(AUTO)
    ground.run(1.5)
    assert ground.last("MISSION_CURRENT").seq == 2


def test_the_mission_restarts_if_so_configured():
    ground = sailing(TRIANGLE, parameters={"MIS_RESTART": 1})
    run_until_reached(ground, 1)
    ground.mode(HOLD)
    ground.mode(AUTO)
    ground.run(1.5)
    assert ground.last("MISSION_CURRENT").seq == 1


def test_a_boat_disarmed_outside_auto_restarts_its_mission():
    ground = sailing(TRIANGLE)
    run_until_reached(ground, 1)
    ground.mode(HOLD)
    ground.command(400, 0)
    ground.run(1.5)
    assert ground.last("MISSION_CURRENT").seq == 0


def test_a_mission_changed_while_running_is_flown_in_its_new_form():
    ground = sailing([waypoint(40 + 0j)])
    ground.run(3.0)
    assert upload(ground, [waypoint(40j)]) == mavlink.MAV_MISSION_ACCEPTED
    ground.run(1.5)
    assert "Auto mission changed, restarted command" in ground.texts()
    sent = item(1, waypoint(40j))
    assert ground.last("POSITION_TARGET_GLOBAL_INT").lon_int == sent.y


@pytest.mark.parametrize(("behaviour", "mode"), [(0, AUTO), (1, AUTO), (2, 1), (3, MANUAL)])
def test_the_mode_after_a_mission_follows_its_parameter(behaviour, mode):
    ground = sailing([waypoint(8 + 0j)], parameters={"MIS_DONE_BEHAVE": behaviour})
    run_until_reached(ground, 1)
    ground.run(1.0)
    assert ground.mode_number == mode


def test_the_pilot_takes_over_by_changing_the_mode():
    ground = sailing([waypoint(60 + 0j)])
    ground.run(10.0)
    ground.mode(MANUAL)
    ground.sticks = {1: 1700, 3: 1500}
    ground.run(1.5)
    assert ground.servos[0] == 1680 and ground.servos[2] == 1500


def test_disarming_ends_every_output():
    ground = sailing([waypoint(60 + 0j)])
    ground.run(10.0)
    assert ground.command(400, 0) == mavlink.MAV_RESULT_ACCEPTED
    ground.run(0.1)
    assert ground.servos[0] == 1500 and ground.servos[2] == 1500
    assert not ground.armed


@pytest.mark.parametrize(("action", "mode"), [(0, AUTO), (1, RTL), (2, HOLD), (3, RTL), (4, HOLD)])
def test_a_lost_radio_ends_the_mission_by_its_parameter(action, mode):
    ground = sailing([waypoint(200 + 0j)], parameters={"FS_ACTION": action})
    ground.run(5.0)
    ground.sticks = None
    ground.run(8.0)
    assert "Radio Failsafe" in ground.texts()
    assert ground.mode_number == mode and ground.armed


def test_a_lost_radio_disarms_if_so_configured():
    ground = sailing([waypoint(200 + 0j)], parameters={"FS_ACTION": 5})
    ground.run(5.0)
    ground.sticks = None
    ground.run(8.0)
    assert not ground.armed


def test_a_lost_radio_lets_the_mission_continue_if_so_configured():
    ground = sailing([waypoint(200 + 0j)], parameters={"FS_THR_ENABLE": 2})
    ground.run(5.0)
    ground.sticks = None
    ground.run(8.0)
    assert "Failsafe - Continuing Auto Mode" in ground.texts()
    assert ground.mode_number == AUTO


def test_a_boat_returns_home_and_stays_there_in_a_current():
    ground = twin(RTL_SPEED=1.0)
    ground.vehicle.state.x += 25.0
    ground.vehicle.plant.water.V_y = 0.2
    ground.run(0.2)
    assert ground.command(mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH) == mavlink.MAV_RESULT_ACCEPTED
    fastest = 0.0
    for _ in range(150):
        ground.run(1.0)
        fastest = max(fastest, speed(ground))
    assert 0.9 < fastest < 1.2
    assert "Reached destination" in ground.texts()
    assert abs(place(ground)) < 6.0


def test_a_boat_cannot_be_armed_in_rtl():
    ground = boat(armed=False)
    ground.run(2.0)
    assert ground.mode(RTL) == 0
    assert ground.command(400, 1) == mavlink.MAV_RESULT_FAILED
    ground.run(0.1)
    assert "Arm: Mode not armable" in ground.texts()


def test_the_station_starts_the_mission_by_command():
    ground = boat()
    upload(ground, TRIANGLE)
    assert ground.command(mavlink.MAV_CMD_MISSION_START, 1, 0) == mavlink.MAV_RESULT_DENIED
    assert ground.command(mavlink.MAV_CMD_MISSION_START) == mavlink.MAV_RESULT_ACCEPTED
    assert ground.mode_number == AUTO
