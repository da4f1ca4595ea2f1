from __future__ import annotations

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tests.sitl.ground import GUIDED, HOLD, MANUAL, Ground, boat, rov

ACCEPTED, DENIED, UNSUPPORTED, FAILED = 0, 2, 3, 4


@pytest.mark.parametrize(("name", "kind", "mode"), [("charlie", 11, MANUAL), ("videoray", 12, 19)])
def test_the_heartbeat_names_type_and_mode(name, kind, mode):
    ground = Ground(name)
    ground.run(1.3)
    beat = ground.last("HEARTBEAT")
    assert (beat.type, beat.autopilot, beat.custom_mode, beat.system_status) == (kind, 3, mode, 3)
    assert beat.base_mode & 1
    assert not beat.base_mode & 128


def test_the_heartbeat_comes_once_a_second_and_shows_arming():
    ground = boat()
    heard = ground.run(10.0)
    beats = [m for m in heard if m.get_type() == "HEARTBEAT"]
    assert len(beats) == 10
    assert all(b.base_mode & 128 and b.system_status == 4 for b in beats)


@pytest.mark.parametrize("mode", [0, 1, 3, 4, 15])
def test_a_boat_enters_each_of_its_modes(mode):
    ground = boat(mode=mode)
    ground.run(1.1)
    assert ground.last("HEARTBEAT").custom_mode == mode


@pytest.mark.parametrize("mode", [19, 0, 2, 4])
def test_an_rov_enters_each_of_its_modes(mode):
    ground = rov(mode=mode)
    ground.run(1.1)
    assert ground.last("HEARTBEAT").custom_mode == mode


@pytest.mark.parametrize(("name", "mode"), [("charlie", 7), ("charlie", 99), ("videoray", 15)])
def test_an_unknown_mode_fails_and_changes_nothing(name, mode):
    ground = Ground(name)
    ground.run(1.0)
    before = ground.mode_number
    assert ground.mode(mode) == FAILED
    assert ground.mode_number == before
    assert f"No such mode {mode}" in ground.texts()


def test_a_mode_without_the_custom_flag_is_not_supported():
    assert Ground("charlie").command(176, 0, HOLD) == UNSUPPORTED


def test_the_old_set_mode_message_is_supported():
    ground = boat()
    ground.send(mavlink.MAVLink_set_mode_message(1, 1, HOLD))
    ground.run(0.1)
    assert ground.mode_number == HOLD


def test_guided_is_rejected_while_armed_without_a_position():
    ground = Ground("charlie")
    ground.sticks = {1: 1500, 3: 1500}
    ground.run(0.5)
    assert ground.command(400, 1, 21196) == ACCEPTED
    assert ground.mode(GUIDED) == FAILED
    assert "Mode change to GUIDED failed: requires position" in ground.texts()


def test_guided_is_accepted_while_disarmed_without_a_position():
    ground = Ground("charlie")
    ground.run(0.5)
    assert ground.mode(GUIDED) == ACCEPTED


def test_command_int_is_understood_like_command_long():
    ground = boat()
    ground.send(mavlink.MAVLink_command_int_message(1, 1, 0, 176, 0, 0, 1, HOLD, 0, 0, 0, 0, 0))
    ground.run(0.1)
    assert ground.mode_number == HOLD
    assert ground.last("COMMAND_ACK").result == ACCEPTED


@pytest.mark.parametrize(("number", "result"), [(22, UNSUPPORTED), (183, FAILED), (178, FAILED), (43000, UNSUPPORTED)])
def test_unsupported_or_invalid_commands_get_an_error_result(number, result):
    assert Ground("charlie").command(number) == result


def test_the_acknowledgement_goes_to_the_sender():
    ground = Ground("charlie", system=42)
    ground.command(512, 0)
    assert (ground.last("COMMAND_ACK").target_system, ground.last("COMMAND_ACK").target_component) == (42, 190)


@pytest.mark.parametrize("request_it", [(512, 148), (520, 1)])
def test_the_version_comes_on_request(request_it):
    ground = Ground("charlie")
    assert ground.command(*request_it) == ACCEPTED
    version = ground.last("AUTOPILOT_VERSION")
    assert version.flight_sw_version >> 16 == 4 << 8 | 7
    assert version.capabilities & mavlink.MAV_PROTOCOL_CAPABILITY_MAVLINK2


def test_an_unknown_message_cannot_be_requested():
    assert Ground("charlie").command(512, 11000) == FAILED


def test_a_boat_sends_no_water_pressure():
    assert Ground("charlie").command(512, mavlink.MAVLINK_MSG_ID_SCALED_PRESSURE2) == FAILED


def test_timesync_is_answered_with_boot_time():
    ground = Ground("charlie")
    ground.run(1.0)
    ground.send(mavlink.MAVLink_timesync_message(0, 123456))
    ground.run(0.02)
    reply = ground.last("TIMESYNC")
    assert (reply.ts1, reply.tc1) == (123456, 1_020_000_000)


def test_a_reboot_is_acknowledged_then_time_starts_again_and_parameters_stay():
    ground = boat(armed=False)
    ground.set("ATC_STR_ANG_P", 3.0)
    ground.run(0.1)
    assert ground.command(246, 1) == ACCEPTED
    ground.run(1.5)
    assert ground.last("ATTITUDE").time_boot_ms < 1600
    assert ground.vehicle.parameters["ATC_STR_ANG_P"] == 3.0
    assert not ground.armed


def test_an_armed_vehicle_does_not_reboot():
    ground = boat()
    assert ground.command(246, 1) == FAILED
    assert ground.armed


@pytest.mark.parametrize("number", [176, 400, 511, 512, 246, 520])
def test_nan_and_infinity_in_commands_are_rejected(number):
    assert Ground("charlie").command(number, float("nan"), float("inf")) in (DENIED, UNSUPPORTED, FAILED)


def test_a_command_for_another_vehicle_gets_no_reply():
    ground = Ground("charlie")
    ground.send(mavlink.MAVLink_command_long_message(2, 1, 400, 0, 1, 0, 0, 0, 0, 0, 0))
    assert not [m for m in ground.run(0.2) if m.get_type() == "COMMAND_ACK"]


def test_a_command_of_another_station_is_obeyed_and_acknowledged_only_at_its_port():
    ground = boat(mode=GUIDED)
    station = mavlink.MAVLink(None, srcSystem=200, srcComponent=190)
    order = mavlink.MAVLink_command_long_message(1, 1, mavlink.MAV_CMD_DO_SET_MODE, 0, 1, HOLD, 0, 0, 0, 0, 0)
    write = mavlink.MAVLink_param_set_message(1, 1, b"ATC_STR_RAT_P", 0.3, 9)
    ground.server.receive_elsewhere(order.pack(station) + write.pack(station))
    heard = ground.run(1.5)
    assert ground.last("HEARTBEAT").custom_mode == HOLD
    assert [m for m in heard if m.get_type() == "COMMAND_ACK"] == []
    assert [m.param_value for m in heard if m.get_type() == "PARAM_VALUE"] == [pytest.approx(0.3)]
