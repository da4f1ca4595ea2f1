from __future__ import annotations

import math
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from scripted_vehicle import ScriptedVehicle

from gcs_autotune.craft import Actuate
from gcs_autotune.errors import CommandDenied, PreconditionFailed, TelemetryFault
from gcs_autotune.firmware import FIRMWARE, Output, ServoMap, read_servo_map
from gcs_autotune.link import Commands, MemoryLink, Parameters, Rates, Session
from gcs_autotune.link.vehicle.telemetry import Recorder, Telemetry
from gcs_autotune.link.vehicle.vehicle_config import RcChannel, read_override_map
from gcs_autotune.trial import Mark

ROVER, SUB = FIRMWARE["ardurover"], FIRMWARE["ardusub"]
fractions = st.floats(-1.0, 1.0).map(lambda x: round(x, 3))


# --- servo outputs --------------------------------------------------------------------------------


@given(fractions, fractions, fractions, fractions, fractions, fractions)
def test_mixed_motors_reproduce_the_forces(N: float, X: float, Y: float, Z: float, K: float, M: float) -> None:
    assert len(SUB.mixing) >= 3
    for factors in SUB.mixing.values():
        outputs = [Output(i, 1500, 1100, 1900) for i in range(1, len(factors) + 1)]
        servos = ServoMap.of_mixing(outputs, factors)
        forces = {name: value for name, value in zip("NXYZKM", (N, X, Y, Z, K, M), strict=True) if name in servos.names}
        pwms = [1500 + 400 * sum(f.get(n, 0.0) * forces.get(n, 0.0) for n in "NXYZKM") for f in factors]
        assert servos.forces([*pwms, *[0] * 8]) == pytest.approx(forces, abs=1e-9)


def servo_map(vehicle: ScriptedVehicle, firmware: Any) -> ServoMap:
    session = Session(MemoryLink(vehicle))
    session.discover()
    return read_servo_map(Parameters(session), firmware)


def test_a_boats_outputs_are_found_by_function_trim_and_direction(boat: ScriptedVehicle) -> None:
    boat.parameters |= {"SERVO1_FUNCTION": 0, "SERVO4_FUNCTION": 26, "SERVO4_TRIM": 1450, "SERVO4_REVERSED": 1}
    boat.parameters |= {"SERVO4_MIN": 1050, "SERVO4_MAX": 1950}
    servos = servo_map(boat, ROVER)
    assert servos.forces([0, 0, 1750, 1050, 0, 0, 0, 0]) == pytest.approx({"X": 0.5, "N": 1.0})
    assert servos.forces([0, 0, 1250, 1700, 0, 0, 0, 0]) == pytest.approx({"X": -0.5, "N": -0.5})


def test_two_side_thrusters_steer_differentially(boat: ScriptedVehicle) -> None:
    assert not servo_map(boat, ROVER).skid
    boat.parameters |= {"SERVO1_FUNCTION": 74, "SERVO3_FUNCTION": 73, "SERVO3_REVERSED": 1}
    servos = servo_map(boat, ROVER)
    assert servos.skid
    assert servos.forces([1600, 0, 1100, 0, 0, 0, 0, 0]) == pytest.approx({"X": 0.5, "N": 0.3})


def test_a_boat_without_a_steering_output_is_refused(boat: ScriptedVehicle) -> None:
    boat.parameters |= {"SERVO1_FUNCTION": 73, "SERVO3_FUNCTION": 0}
    with pytest.raises(PreconditionFailed, match=r"N \(26\), X \(70\)"):
        servo_map(boat, ROVER)


def test_disordered_servo_limits_are_refused(boat: ScriptedVehicle) -> None:
    boat.parameters["SERVO1_TRIM"] = 2100
    with pytest.raises(PreconditionFailed, match="SERVO1_MIN 1000, TRIM 2100"):
        servo_map(boat, ROVER)


def test_an_rovs_motors_turn_in_their_configured_direction(rov: ScriptedVehicle) -> None:
    rov.parameters |= {"MOT_2_DIRECTION": -1, "MOT_3_DIRECTION": -1}
    servos = servo_map(rov, SUB)
    assert servos.forces([1380, 1380, 1460, 0, 0, 0, 0, 0]) == pytest.approx({"X": 0.0, "N": 0.3, "Z": 0.1})


def test_an_rovs_motors_may_be_on_other_outputs(rov: ScriptedVehicle) -> None:
    rov.parameters |= {"SERVO3_FUNCTION": 0, "SERVO8_FUNCTION": 35}
    servos = servo_map(rov, SUB)
    assert servos.forces([1500, 1500, 1900, 0, 0, 0, 0, 1540])["Z"] == pytest.approx(0.1)


def test_an_unknown_frame_is_refused_by_number(rov: ScriptedVehicle) -> None:
    rov.parameters["FRAME_CONFIG"] = 9
    with pytest.raises(PreconditionFailed, match="FRAME_CONFIG 9 is not supported"):
        servo_map(rov, SUB)


# --- overrides --------------------------------------------------------------------------------


@given(fractions)
def test_the_dead_zone_is_compensated(fraction: float) -> None:
    """ArduRover as measured: output = sign * 500 * (|rc - 1500| - 30) / 470."""
    channel = RcChannel(1000, 1500, 2000, dead_zone=30)
    pwm = channel.pwm(fraction)
    output = math.copysign(max(abs(pwm - 1500) - 30, 0) / 470, pwm - 1500)
    assert 1000 <= pwm <= 2000
    assert output == pytest.approx(fraction, abs=1.1e-3)


def test_a_reversed_channel_is_driven_the_other_way(boat: ScriptedVehicle) -> None:
    boat.parameters["RC1_REVERSED"] = 1
    session = Session(MemoryLink(boat))
    session.discover()
    overrides = read_override_map(Parameters(session), ROVER)
    message = overrides.message(overrides.values(Actuate(N=0.5, X=0.5)), 1, 1)
    assert (message.chan1_raw, message.chan3_raw) == (1500 - 265, 1500 + 265)
    assert {getattr(message, f"chan{n}_raw") for n in (2, 4, 5, 6, 7, 8)} == {65535}
    assert {getattr(message, f"chan{n}_raw") for n in range(9, 19)} == {0}


# --- signals --------------------------------------------------------------------------------


SERVOS = ServoMap.of_mixing([Output(1, 1500, 1000, 2000), Output(3, 1500, 1000, 2000)], [{"N": 1.0}, {"X": 1.0}])


class FedTelemetry:
    """A session with a telemetry that receives messages directly."""

    def __init__(self, session: Session, boat: ScriptedVehicle) -> None:
        self.recorder = Recorder()
        self.telemetry = Telemetry(session, SERVOS, self.recorder)
        self._session, self._boat = session, boat

    def feed(self, *messages: Any) -> Telemetry:
        for message in messages:
            self._boat.send(message)
        self._session.pump()
        return self.telemetry


@pytest.fixture
def feeder(session: Session, boat: ScriptedVehicle) -> FedTelemetry:
    return FedTelemetry(session, boat)


def attitude(ms: int, yaw: float = 0.0, yawspeed: float = 0.0) -> Any:
    return mavlink.MAVLink_attitude_message(ms, 0.01, 0.02, yaw, 0.0, 0.0, yawspeed)


def test_velocity_is_rotated_into_the_body_frame_at_its_own_time(feeder: FedTelemetry) -> None:
    telemetry = feeder.feed(
        attitude(1000, yaw=math.pi / 2 - 0.1, yawspeed=0.5),
        mavlink.MAVLink_local_position_ned_message(1200, 10.0, 20.0, -1.0, -0.5, 2.0, 0.25),
    )
    assert telemetry.value("u") == pytest.approx(2.0)
    assert telemetry.value("v") == pytest.approx(0.5)
    assert telemetry.value("U") == pytest.approx(math.hypot(2.0, 0.5))
    assert (telemetry.value("x"), telemetry.value("y"), telemetry.value("z")) == (10.0, 20.0, -1.0)


def test_depth_is_minus_relative_altitude_and_positive_down(feeder: FedTelemetry) -> None:
    telemetry = feeder.feed(
        attitude(1000), mavlink.MAVLink_global_position_int_message(1000, 0, 0, 0, -2500, 100, 0, 30, 0)
    )
    assert telemetry.value("z") == pytest.approx(2.5)
    assert telemetry.value("w") == pytest.approx(0.3)
    assert math.isnan(telemetry.value("u")), "without a fix the velocity is not known to be zero"


def test_a_position_that_the_estimator_has_lost_is_not_used(feeder: FedTelemetry) -> None:
    def status(flags: int) -> Any:
        return mavlink.MAVLink_ekf_status_report_message(flags, 0.1, 0.1, 0.1, 0.1, 0.0)

    place = mavlink.MAVLink_local_position_ned_message(1200, 10.0, 20.0, 3.0, 0.5, 0.0, 0.0)
    never_had_one, has_one = 167, 831
    assert feeder.feed(attitude(1000), status(never_had_one), place).value("x") == 10.0
    assert feeder.feed(status(has_one), place).value("x") == 10.0
    lost = feeder.feed(status(never_had_one), place)
    assert math.isnan(lost.value("x")) and math.isnan(lost.value("u")) and lost.value("z") == 3.0
    assert feeder.feed(status(has_one), place).value("x") == 10.0


def test_home_and_origin_may_be_at_different_depths(feeder: FedTelemetry) -> None:
    local = mavlink.MAVLink_local_position_ned_message(1000, 0.0, 0.0, 2.53, 0.0, 0.0, 0.0)
    telemetry = feeder.feed(
        attitude(1000), local, mavlink.MAVLink_global_position_int_message(1000, 0, 0, 0, -2500, 100, 0, 30, 0)
    )
    assert telemetry.depth_offset == pytest.approx(0.03)
    telemetry = feeder.feed(mavlink.MAVLink_global_position_int_message(1600, 0, 0, 0, -3500, 100, 0, 30, 0))
    assert telemetry.depth_offset == pytest.approx(0.03), "messages of different moments say nothing about it"


def depths(ms: int, below_origin: float, below_home: float) -> tuple[Any, Any]:
    """Return the two depth messages [m] of one moment: below the estimator's origin, and below home."""
    local = mavlink.MAVLink_local_position_ned_message(ms, 0.0, 0.0, below_origin, 0.0, 0.0, 0.0)
    return local, mavlink.MAVLink_global_position_int_message(ms, 0, 0, 0, round(-1e3 * below_home), 100, 0, 0, 0)


def test_the_depth_offset_of_home_is_found_in_ardupilots_message_order(feeder: FedTelemetry) -> None:
    """Home is reset at arming: at 200 s ArduSub 4.5 sent -0.46 m below home, then -0.05 m, 0.19 m below origin."""
    order = [m for k in range(5) for m in reversed(depths(1000 + 100 * k, 0.19 + 0.1 * k, 0.46 + 0.1 * k))]
    telemetry = feeder.feed(attitude(1000), *order)
    assert telemetry.depth_offset == pytest.approx(-0.27, abs=1e-3)
    again = [m for k in range(5) for m in reversed(depths(1500 + 100 * k, 0.19, 0.01))]
    assert feeder.feed(attitude(1500), *again).depth_offset == pytest.approx(0.18, abs=1e-3)


def test_the_depth_offset_of_home_is_found_from_messages_at_different_times(feeder: FedTelemetry) -> None:
    staggered = []
    for k in range(5):
        staggered += [depths(1000 + 100 * k, 0.5 + 0.1 * k, 0.0)[0], depths(1060 + 100 * k, 0.0, 0.31 + 0.1 * k)[1]]
    assert feeder.feed(attitude(1000), *staggered).depth_offset == pytest.approx(0.25, abs=2e-3)


def global_position(ms: int, north: float) -> Any:
    lat = round(54e7 + math.degrees(north / 6378137.0) * 1e7)
    return mavlink.MAVLink_global_position_int_message(ms, lat, 100000000, 0, 0, 150, 0, 0, 0)


def test_gps_replaces_a_missing_local_position(feeder: FedTelemetry) -> None:
    for second in range(5):
        telemetry = feeder.feed(attitude(second * 1000), global_position(second * 1000, 3.0 * second))
    assert telemetry.value("x") == pytest.approx(6.0, abs=0.02)
    assert telemetry.value("u") == pytest.approx(1.5)


def test_gps_replaces_the_local_position_after_a_wait_whatever_the_vehicles_clock(feeder: FedTelemetry) -> None:
    for second in range(3):
        at = 100_000 + 1000 * second
        telemetry = feeder.feed(attitude(at), global_position(at, 0.0))
        assert math.isfinite(telemetry.value("x")) == (second >= 2)


def test_longitude_is_metres_east_at_that_latitude(feeder: FedTelemetry) -> None:
    for second, degrees in enumerate((10.0, 10.0, 10.0, 10.0001)):
        fix = mavlink.MAVLink_global_position_int_message(
            1000 * second, 540000000, round(degrees * 1e7), 0, 0, 0, 0, 0, 0
        )
        telemetry = feeder.feed(attitude(1000 * second), fix)
    assert telemetry.fix == pytest.approx((54.0, 10.0001))
    assert telemetry.value("y") == pytest.approx(
        6378137.0 * math.radians(1e-4) * math.cos(math.radians(54.0)), rel=5e-3
    )


def test_two_position_sources_are_never_mixed(feeder: FedTelemetry) -> None:
    local = mavlink.MAVLink_local_position_ned_message(1000, 100.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    telemetry = feeder.feed(attitude(1000), local, *(global_position(1000 * s, 3.0 * s) for s in range(1, 6)))
    assert telemetry.value("x") == 100.0


def test_battery_and_prearm_come_from_sys_status(feeder: FedTelemetry) -> None:
    bit = 0x10000000
    telemetry = feeder.feed(
        attitude(1000), mavlink.MAVLink_sys_status_message(bit, bit, 0, 0, 11800, 0, 61, 0, 0, 0, 0, 0, 0)
    )
    assert telemetry.value("battery") == pytest.approx(11.8)
    assert telemetry.value("battery_remaining") == pytest.approx(0.61)
    assert telemetry.value("prearm_ok") == 0.0


def test_water_pressure_is_in_pascals_at_its_own_time(feeder: FedTelemetry) -> None:
    feeder.feed(attitude(900))
    feeder.recorder.start("dive")
    telemetry = feeder.feed(
        attitude(1000),
        mavlink.MAVLink_scaled_pressure2_message(1100, 1013.25, 0.0, 2000),
        mavlink.MAVLink_scaled_pressure2_message(1350, 1111.25, 0.0, 2000),
    )
    assert telemetry.value("pressure") == pytest.approx(111125.0)
    pressure = feeder.recorder.stop("completed", "", {}).channels["pressure"]
    assert pressure.t.tolist() == pytest.approx([1.1, 1.35])
    assert pressure.values.tolist() == pytest.approx([101325.0, 111125.0])


def test_an_unmeasured_battery_stays_unknown(feeder: FedTelemetry) -> None:
    telemetry = feeder.feed(
        attitude(1000), mavlink.MAVLink_sys_status_message(0, 0, 0, 0, 65535, 0, -1, 0, 0, 0, 0, 0, 0)
    )
    assert math.isnan(telemetry.value("battery"))
    assert math.isnan(telemetry.value("battery_remaining"))


def test_a_trial_contains_every_sample_with_its_own_stamp(feeder: FedTelemetry) -> None:
    feeder.feed(attitude(900))
    feeder.recorder.start("turn")
    feeder.feed(
        attitude(1000, yaw=3.0),
        mavlink.MAVLink_servo_output_raw_message(1_020_000, 0, 1750, 0, 1500, 0, 0, 0, 0, 0),
        attitude(1100, yaw=-3.0),
        attitude(1050, yaw=2.0),
        mavlink.MAVLink_servo_output_raw_message(1_120_000, 1, 2000, 0, 2000, 0, 0, 0, 0, 0),
    )
    feeder.recorder.mark(Mark(1.1, "switch"))
    trial = feeder.recorder.stop("completed", "", {"a": 1})
    assert trial["psi"].t.tolist() == pytest.approx([1.0, 1.1])
    assert trial["psi"].values.tolist() == pytest.approx([3.0, math.tau - 3.0])
    assert trial["N"].t.tolist() == pytest.approx([1.02])
    assert (trial["N"].values.tolist(), trial["N"].unit) == ([0.5], "1")
    assert (trial.ending, trial.marks[0].kind, trial.meta["a"]) == ("completed", "switch", 1)


# --- rates --------------------------------------------------------------------------------


@pytest.fixture
def rates(session: Session) -> Rates:
    return Rates(session, Commands(session, ROVER))


def test_a_denied_rate_is_halved_until_it_is_granted(rates: Rates, session: Session) -> None:
    assert rates.request({"ATTITUDE": 100.0, "VFR_HUD": 4.0}) == {"ATTITUDE": 25.0, "VFR_HUD": 4.0}
    assert any("requested 100 Hz, but the vehicle grants 25 Hz" in note for note in session.notes)


def test_a_rate_never_granted_is_zero(rates: Rates, session: Session, boat: ScriptedVehicle) -> None:
    boat.fastest = 0.1
    assert rates.request({"ATTITUDE": 10.0}) == {"ATTITUDE": 0.0}


def test_rates_are_measured_on_the_vehicles_clock(rates: Rates) -> None:
    rates.request({"ATTITUDE": 10.0, "SERVO_OUTPUT_RAW": 25.0})
    measured = rates.measure({"ATTITUDE": 10.0, "SERVO_OUTPUT_RAW": 25.0})
    assert measured == pytest.approx({"ATTITUDE": 10.0, "SERVO_OUTPUT_RAW": 25.0}, rel=0.1)


def test_a_low_rate_is_a_fault_with_the_measured_rate(rates: Rates) -> None:
    rates.request({"ATTITUDE": 2.0})
    with pytest.raises(TelemetryFault, match=r"ATTITUDE 2\.\d Hz of 10"):
        rates.measure({"ATTITUDE": 10.0})


def test_no_attitude_at_all_is_a_fault(rates: Rates) -> None:
    with pytest.raises(TelemetryFault, match="no ATTITUDE"):
        rates.measure({"ATTITUDE": 10.0})


def test_rates_are_restored(rates: Rates, boat: ScriptedVehicle) -> None:
    boat.intervals[mavlink.MAVLINK_MSG_ID_ATTITUDE] = 0.5
    rates.request({"ATTITUDE": 10.0, "VFR_HUD": 5.0})
    rates.request({"ATTITUDE": 20.0})
    rates.restore()
    assert boat.intervals[mavlink.MAVLINK_MSG_ID_ATTITUDE] == pytest.approx(0.5)
    assert boat.intervals[mavlink.MAVLINK_MSG_ID_VFR_HUD] == pytest.approx(0.25)
    assert rates.granted == {}


def test_a_rate_never_granted_is_not_reported_as_not_restored(
    rates: Rates, session: Session, monkeypatch: pytest.MonkeyPatch
) -> None:
    def deny(name: str, interval: int) -> None:
        raise CommandDenied(f"{name} denied")

    monkeypatch.setattr(rates, "_set_interval", deny)
    assert rates.request({"DISTANCE_SENSOR": 10.0}) == {"DISTANCE_SENSOR": 0.0}
    rates.restore()
    assert not [note for note in session.notes if "not restored" in note]
    monkeypatch.undo()
    rates.request({"ATTITUDE": 10.0})
    monkeypatch.setattr(rates, "_set_interval", deny)
    rates.restore()
    assert [note for note in session.notes if "the rate of ATTITUDE was not restored" in note]
