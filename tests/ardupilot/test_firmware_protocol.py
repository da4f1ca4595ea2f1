"""Discovery, parameters, modes, rates: our simulator responds as ArduPilot's does, and the tool works with both."""

from __future__ import annotations

import itertools
import math

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs_autotune.errors import ParameterMissing
from gcs_autotune.link import open_craft

ACCEPTED, DENIED, FAILED = mavlink.MAV_RESULT_ACCEPTED, mavlink.MAV_RESULT_DENIED, mavlink.MAV_RESULT_FAILED
GAIN = {"boat": "ATC_STR_RAT_P", "rov": "ATC_RAT_YAW_P"}
UNKNOWN = "NO_SUCH_GAIN"


def interval(station, name: str, hz: float) -> int:
    number = getattr(mavlink, f"MAVLINK_MSG_ID_{name}")
    return station.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, number, 1e6 / hz)


def test_the_vehicle_is_discovered_with_its_type_and_version(craft):
    vehicle = craft.session.vehicle
    assert (vehicle.system, vehicle.component, vehicle.autopilot) == (1, 1, mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA)
    kinds = {"boat": mavlink.MAV_TYPE_SURFACE_BOAT, "rov": mavlink.MAV_TYPE_SUBMARINE}
    assert vehicle.vehicle_type == kinds[craft.firmware.kind]
    assert vehicle.version.startswith("4.")


def test_a_gain_is_written_read_back_and_restored_as_a_32_bit_float(craft):
    name = GAIN[craft.firmware.kind]
    old = craft.parameters.read(name)
    craft.parameters.write(name, 0.33)
    assert craft.parameters.read(name) == pytest.approx(0.33, abs=1e-7)
    assert craft.parameters.read(name) != 0.33
    craft.parameters.write(name, old)
    assert craft.parameters.read(name) == old


def test_values_outside_the_documented_range_are_accepted(craft):
    name = GAIN[craft.firmware.kind]
    old = craft.parameters.read(name)
    craft.parameters.write(name, 99.0)
    assert craft.parameters.read(name) == 99.0
    craft.parameters.write(name, old)


def test_an_unknown_parameter_is_reported_missing(craft):
    with pytest.raises(ParameterMissing, match=UNKNOWN):
        craft.parameters.read(UNKNOWN)
    known = GAIN[craft.firmware.kind]
    assert set(craft.parameters.read_existing([UNKNOWN, known])) == {known}


def test_an_unknown_name_and_an_infinite_value_both_cause_param_error_or_no_reply(craft):
    """PARAM_ERROR is new in 4.7."""
    errors: list[tuple[str, int]] = []
    stop = craft.session.listen("PARAM_ERROR", lambda m: errors.append((m.param_id, m.error)))
    craft.session.send(mavlink.MAVLink_param_request_read_message(1, 1, UNKNOWN.encode(), -1))
    craft.session.send(mavlink.MAVLink_param_set_message(1, 1, UNKNOWN.encode(), 1.0, 9))
    name = GAIN[craft.firmware.kind]
    craft.session.send(mavlink.MAVLink_param_set_message(1, 1, name.encode(), math.inf, 9))
    craft.run(1.0)
    stop()
    absent, impossible = mavlink.MAV_PARAM_ERROR_DOES_NOT_EXIST, mavlink.MAV_PARAM_ERROR_VALUE_OUT_OF_RANGE
    assert sorted(errors) in ([], sorted([(UNKNOWN, absent), (UNKNOWN, absent), (name, impossible)]))


def test_a_nan_value_is_not_accepted(craft):
    name = GAIN[craft.firmware.kind]
    old = craft.parameters.read(name)
    craft.session.send(mavlink.MAVLink_param_set_message(1, 1, name.encode(), math.nan, 9))
    craft.run(0.5)
    assert craft.parameters.read(name) == old


def test_an_integer_parameter_drops_the_fraction(boat):
    old = boat.parameters.read("CRUISE_THROTTLE")
    boat.session.send(mavlink.MAVLink_param_set_message(1, 1, b"CRUISE_THROTTLE", 33.7, 9))
    boat.run(0.5)
    assert boat.parameters.read("CRUISE_THROTTLE") == 33.0
    boat.parameters.write("CRUISE_THROTTLE", old)


def test_the_full_parameter_list_is_complete(craft):
    values = craft.parameters.read_full()
    assert values[GAIN[craft.firmware.kind]] > 0.0
    assert [values[name] for name in craft.firmware.gcs_id_parameters if name in values] == [255.0]
    assert len(values) > 200


def test_a_disarmed_vehicle_accepts_every_mode_used_in_flight(craft):
    firmware = craft.firmware
    for mode in (firmware.hold_mode, firmware.rest_mode, firmware.manual_mode):
        craft.commands.set_mode(mode)
        assert craft.mode == mode


def test_a_mode_that_does_not_exist_is_refused(craft):
    before = craft.mode
    assert craft.command(mavlink.MAV_CMD_DO_SET_MODE, 1.0, 99.0) != ACCEPTED
    craft.run(1.5)
    assert craft.mode == before


def test_rover_denies_rates_above_its_50_hz_loop_and_keeps_the_old_rate(boat):
    assert interval(boat, "ATTITUDE", 40.0) == ACCEPTED
    if boat.session.vehicle.version.startswith("4.5"):  # it takes any rate, and sends as fast as its loop goes
        assert interval(boat, "ATTITUDE", 100.0) == ACCEPTED
        assert 35.0 < boat.rates.measure({"ATTITUDE": 30.0})["ATTITUDE"] < 55.0
        return
    assert interval(boat, "ATTITUDE", 50.0) == DENIED
    assert boat.rates.request({"ATTITUDE": 100.0}) == {"ATTITUDE": 25.0}
    assert boat.rates.measure({"ATTITUDE": 25.0})["ATTITUDE"] == pytest.approx(25.0, rel=0.05)
    assert any("too fast" in text for _, text in boat.texts)


def test_rover_sends_40_hz_at_uneven_intervals(boat):
    assert interval(boat, "ATTITUDE", 40.0) == ACCEPTED
    boat.run(0.5)
    stamps: list[int] = []
    stop = boat.session.listen("ATTITUDE", lambda m: stamps.append(m.time_boot_ms))
    boat.run(2.0)
    stop()
    gaps = {b - a for a, b in itertools.pairwise(stamps)}
    assert {20, 40} <= {round(gap, -1) for gap in gaps} <= {20, 30, 40}
    assert 1000.0 * (len(stamps) - 1) / (stamps[-1] - stamps[0]) == pytest.approx(40.0, rel=0.04)


def test_sub_grants_50_hz_of_attitude_and_outputs(rov):
    assert rov.rates.request({"ATTITUDE": 25.0, "SERVO_OUTPUT_RAW": 40.0}) == {
        "ATTITUDE": 25.0,
        "SERVO_OUTPUT_RAW": 40.0,
    }
    measured = rov.rates.measure({"ATTITUDE": 25.0, "SERVO_OUTPUT_RAW": 40.0})
    assert measured["ATTITUDE"] == pytest.approx(25.0, rel=0.06)
    assert measured["SERVO_OUTPUT_RAW"] == pytest.approx(40.0, rel=0.06)


def test_a_message_that_is_never_sent_is_refused_and_does_not_affect_the_others(craft):
    granted = craft.rates.request({"WHEEL_DISTANCE": 5.0, "ATTITUDE": 10.0})
    assert granted["ATTITUDE"] == 10.0


def test_message_rates_are_restored(craft):
    before = craft.rates._previous_interval("VFR_HUD")
    craft.rates.request({"VFR_HUD": 7.0})
    assert craft.rates._previous_interval("VFR_HUD") == pytest.approx(1e6 / 7.0, rel=0.2)
    craft.rates.restore()
    assert craft.rates._previous_interval("VFR_HUD") == before


def test_connecting_adopts_the_ground_station_id_that_the_vehicle_obeys(craft):
    name, _ = craft.parameters.read_first(craft.firmware.gcs_id_parameters)
    craft.parameters.write(name, 77)
    try:
        connected = open_craft(craft.session)
        assert craft.session.port.system == 77
        connected.rates.restore()
    finally:
        craft.parameters.write(name, 255)
        craft.session.port.system = 255
    assert any("77" in note for note in craft.session.notes)
