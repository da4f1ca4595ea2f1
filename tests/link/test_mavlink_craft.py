from __future__ import annotations

import math
from collections.abc import Callable
from itertools import pairwise
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from scripted_vehicle import BOAT, ROV, ScriptedVehicle

from gcs_autotune.craft import Actuate, Craft, DepthTarget, HeadingTarget, TurnRateTarget
from gcs_autotune.errors import (
    ArmingRefused,
    GuardTripped,
    LinkError,
    LinkLost,
    NotAsFound,
    OperatorStopped,
    TelemetryFault,
    WrongVehicle,
)
from gcs_autotune.link import MavlinkCraft, MemoryLink, Session, open_craft


def connect(vehicle: ScriptedVehicle, interrupt: Callable[[], bool] = lambda: False) -> MavlinkCraft:
    return open_craft(Session(MemoryLink(vehicle), interrupt=interrupt), arm_patience=3.0)


@pytest.fixture
def craft(boat: ScriptedVehicle) -> Craft:
    """A connected boat; the type checker verifies here that it is a ``Craft``."""
    return connect(boat)


@pytest.fixture
def flying(boat: ScriptedVehicle) -> MavlinkCraft:
    """A connected, armed boat that steers."""
    craft = connect(boat)
    craft.arm()
    craft.send(Actuate(N=0.4, X=0.5))
    for _ in range(5):
        craft.observe()
    return craft


def test_a_stop_during_a_mode_change_does_not_leave_the_autopilot_steering(
    flying: MavlinkCraft, boat: ScriptedVehicle, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Ctrl-C came between order and heartbeat: ArduSub was in ALT_HOLD by then, and pushed at full thrust."""

    def cut_off(mode: str) -> None:
        boat.mode = flying.firmware.modes[mode]
        raise OperatorStopped("stopped by the operator")

    with monkeypatch.context() as while_cut_off:
        while_cut_off.setattr(flying.commands, "set_mode", cut_off)
        with pytest.raises(OperatorStopped):
            flying.set_mode("GUIDED")
    assert (flying.mode, boat.mode) == ("MANUAL", 15), "no heartbeat has arrived yet"
    flying.neutral()
    assert boat.mode == flying.firmware.modes["HOLD"]


# --- boarding --------------------------------------------------------------------------------


def test_connecting_identifies_firmware_and_vehicle(craft: Craft) -> None:
    assert isinstance(craft, MavlinkCraft)
    assert craft.firmware.name == "ArduRover"
    assert craft.session.vehicle is not None
    assert (craft.session.vehicle.firmware, craft.session.vehicle.frame) == ("ArduRover", None)


def test_a_vehicle_of_another_type_is_refused_by_name() -> None:
    with pytest.raises(WrongVehicle, match="QUADROTOR"):
        connect(ScriptedVehicle(2))


@pytest.mark.parametrize(
    ("aboard", "system", "reported"),
    [
        ({"MAV_GCS_SYSID": 255}, 255, ""),
        ({"SYSID_MYGCS": 252}, 252, "SYSID_MYGCS is 252: using system id 252"),
        ({"MAV_GCS_SYSID": 250, "SYSID_MYGCS": 252}, 250, "MAV_GCS_SYSID is 250: using system id 250"),
        ({}, 255, "the vehicle does not report which ground station it obeys. Using system id 255"),
    ],
)
def test_the_ground_station_id_that_the_vehicle_obeys_is_adopted_and_reported(
    boat: ScriptedVehicle, aboard: dict[str, float], system: int, reported: str
) -> None:
    del boat.parameters["MAV_GCS_SYSID"]
    boat.parameters |= aboard
    craft = connect(boat)
    assert craft.session.port.system == system
    assert [note for note in craft.session.notes if "system id" in note] == ([reported] if reported else [])
    craft.arm()
    craft.send(Actuate(N=0.5))
    craft.observe()
    assert craft.observe().output["N"] == pytest.approx(0.5, abs=0.01)


def test_telemetry_too_slow_for_control_restores_the_rates(boat: ScriptedVehicle) -> None:
    boat.mute.add("SERVO_OUTPUT_RAW")
    with pytest.raises(TelemetryFault, match="SERVO_OUTPUT_RAW 0"):
        connect(boat)
    assert boat.intervals[mavlink.MAVLINK_MSG_ID_ATTITUDE] == pytest.approx(0.25)


def test_a_vehicle_that_grants_no_rates_and_streams_nothing_is_refused(boat: ScriptedVehicle) -> None:
    boat.fastest = 0.1
    with pytest.raises(TelemetryFault, match="no ATTITUDE"):
        connect(boat)


def test_stopping_while_connecting_restores_the_rates(boat: ScriptedVehicle) -> None:
    stop = False
    session = Session(MemoryLink(boat), interrupt=lambda: stop)
    session.discover()

    def stop_once_attitude_flows() -> None:
        nonlocal stop
        stop = boat.intervals.get(mavlink.MAVLINK_MSG_ID_ATTITUDE, 1.0) < 0.2

    session.every(0.1, stop_once_attitude_flows)
    with pytest.raises(OperatorStopped):
        open_craft(session)
    boat.advance_to(boat.time + 0.1)
    assert boat.intervals[mavlink.MAVLINK_MSG_ID_ATTITUDE] == pytest.approx(0.25)


def test_in_simulated_time_a_decision_is_taken_at_its_own_tick(craft: Craft) -> None:
    for _ in range(20):
        observation = craft.observe()
        assert craft.clock.now() == pytest.approx(observation.t, abs=1e-6)


# --- observing --------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", [BOAT, ROV])
def test_the_requested_outputs_appear_at_the_actuators(kind: int) -> None:
    craft = connect(ScriptedVehicle(kind))
    craft.arm()
    requested = Actuate(N=0.3, X=-0.2, Z=0.0 if kind == BOAT else 0.25)
    craft.send(requested)
    craft.observe()
    output = craft.observe().output
    assert output == pytest.approx({name: getattr(requested, name) for name in output}, abs=0.01)


def test_heading_is_continuous_beyond_half_a_turn(flying: MavlinkCraft) -> None:
    psi = [flying.observe().psi for _ in range(200)]
    assert psi[-1] > math.pi
    assert all(0.0 < b - a < 0.1 for a, b in pairwise(psi))


def test_an_observation_contains_everything_known(flying: MavlinkCraft) -> None:
    seen = flying.observe()
    assert (seen.armed, seen.mode, seen.speed) == (True, "MANUAL", 1.25)
    assert seen.battery_voltage == pytest.approx(12.6)
    assert seen.r == pytest.approx(0.2, abs=0.01)
    assert seen.value("z") == 0.0


def test_a_command_stays_in_force_without_repetition_by_the_manoeuvre(
    flying: MavlinkCraft, boat: ScriptedVehicle
) -> None:
    flying.session.pause(10.0)
    assert boat.servos[0] == pytest.approx(1700, abs=2)
    before = boat.count("RC_CHANNELS_OVERRIDE")
    flying.session.pause(5.0)
    assert boat.count("RC_CHANNELS_OVERRIDE") - before >= 50


def test_overrides_flow_at_25_hz_whatever_the_control_rate(flying: MavlinkCraft, boat: ScriptedVehicle) -> None:
    before, begun = boat.count("RC_CHANNELS_OVERRIDE"), boat.time
    for _ in range(100):
        flying.observe()
        flying.send(Actuate(N=-0.4))
    sent = (boat.count("RC_CHANNELS_OVERRIDE") - before) / (boat.time - begun)
    assert 25.0 <= sent <= 35.0
    assert flying.link_times.override_rate >= 25.0
    assert flying.link_times.override_gap <= 0.05


def test_a_vehicle_with_accelerated_time_gets_its_overrides_in_time(
    flying: MavlinkCraft, boat: ScriptedVehicle
) -> None:
    flying._streamer._task.period = 1e9
    before = boat.count("RC_CHANNELS_OVERRIDE")
    flying.session.pause(5.0)
    assert boat.count("RC_CHANNELS_OVERRIDE") - before >= 24


def test_silence_in_flight_is_a_lost_link(flying: MavlinkCraft, boat: ScriptedVehicle) -> None:
    boat.alive = False
    with pytest.raises(LinkError):
        for _ in range(3):
            flying.observe()


def test_a_stream_that_stops_is_a_telemetry_fault(flying: MavlinkCraft, boat: ScriptedVehicle) -> None:
    boat.mute.add("ATTITUDE")
    with pytest.raises(TelemetryFault, match="stream rates"):
        flying.observe()


def spoil(boat: ScriptedVehicle, **fields: Callable[[Any], float]) -> None:
    def edit(message: Any) -> Any:
        if message.get_type() == "ATTITUDE":
            for name, value in fields.items():
                setattr(message, name, value(message))
        return message

    boat.edit = edit


def observe_until_fault(craft: MavlinkCraft) -> str:
    with pytest.raises(TelemetryFault) as caught:
        for _ in range(200):
            craft.observe()
    return str(caught.value)


def test_nan_attitude_is_a_fault(flying: MavlinkCraft, boat: ScriptedVehicle) -> None:
    spoil(boat, yaw=lambda _: math.nan)
    assert "not a number" in observe_until_fault(flying)


def test_frozen_attitude_is_a_fault(flying: MavlinkCraft, boat: ScriptedVehicle) -> None:
    spoil(boat, roll=lambda _: 0.1, yaw=lambda _: 0.2, yawspeed=lambda _: 0.0)
    assert "frozen" in observe_until_fault(flying)


def test_a_stopped_clock_is_a_fault(flying: MavlinkCraft, boat: ScriptedVehicle) -> None:
    stamp = round(flying.observe().t * 1000)
    spoil(boat, time_boot_ms=lambda _: stamp)
    assert "its clock stopped" in observe_until_fault(flying)


@pytest.mark.parametrize(("jump", "words"), [(-3.0, "its clock jumped back"), (30.0, "its clock jumped")])
def test_a_jumping_clock_is_a_fault(flying: MavlinkCraft, boat: ScriptedVehicle, jump: float, words: str) -> None:
    boat.boot_offset = jump
    assert words in observe_until_fault(flying)


def test_after_a_fault_the_vehicle_can_still_be_brought_to_rest(flying: MavlinkCraft, boat: ScriptedVehicle) -> None:
    spoil(boat, yaw=lambda _: math.nan)
    observe_until_fault(flying)
    flying.neutral()
    assert boat.servos[:3] == [1500, 1500, 1500]
    flying.parameters.write("WP_SPEED", 1.5)


# --- other hands --------------------------------------------------------------------------------


def test_a_foreign_mode_change_trips_the_guard_with_the_vehicles_message(
    flying: MavlinkCraft, boat: ScriptedVehicle
) -> None:
    boat.mode = 4
    boat.say("Radio Failsafe")
    with pytest.raises(GuardTripped, match=r"from MANUAL to HOLD, not by this tool .*Radio Failsafe") as caught:
        for _ in range(30):
            flying.observe()
    assert caught.value.guard == "mode"


def test_our_own_mode_changes_do_not_trip_the_guard(flying: MavlinkCraft) -> None:
    for mode in ("GUIDED", "MANUAL"):
        flying.set_mode(mode)
        seen = [flying.observe() for _ in range(30)]
        assert {o.mode for o in seen} == {mode}
        assert {o.armed for o in seen} == {True}


# --- targets --------------------------------------------------------------------------------


def test_a_boats_heading_target_is_an_attitude_and_a_fraction_of_full_speed(
    flying: MavlinkCraft, boat: ScriptedVehicle
) -> None:
    flying.set_mode("GUIDED")
    flying.send(HeadingTarget(psi=2.0 + 4 * math.pi, speed=0.5))
    flying.observe()
    target = boat.last("SET_ATTITUDE_TARGET")
    assert target.q == pytest.approx([math.cos(1.0), 0.0, 0.0, math.sin(1.0)], abs=1e-6)
    assert (target.thrust, target.type_mask) == (0.25, 0b111)
    assert boat.last("RC_CHANNELS_OVERRIDE").chan1_raw == 1500


def test_a_boats_turn_rate_target_is_a_body_rate_and_a_fraction_of_full_speed(
    flying: MavlinkCraft, boat: ScriptedVehicle
) -> None:
    flying.set_mode("GUIDED")
    flying.send(TurnRateTarget(r=-0.2, speed=1.0))
    flying.observe()
    target = boat.last("SET_ATTITUDE_TARGET")
    assert (target.body_yaw_rate, target.thrust) == (pytest.approx(-0.2), 0.5)
    assert not target.type_mask & (0b100 | 1 << 6)
    assert boat.last("RC_CHANNELS_OVERRIDE").chan1_raw == 1500


def test_an_rovs_turn_rate_is_a_yaw_stick_position_beyond_the_scaled_dead_zone(rov: ScriptedVehicle) -> None:
    """As measured: rate = (|rc - 1500| - 40 gain)/(400 - 40 gain) of 45 deg/s times ACRO_YAW_P."""
    rov.parameters |= {"ACRO_YAW_P": 3.375, "RC4_DZ": 40, "JS_GAIN_DEFAULT": 0.5}
    craft = connect(rov)
    craft.arm()
    craft.set_mode("ALT_HOLD")
    for rate in (0.3, -0.3):
        craft.send(TurnRateTarget(r=rate))
        craft.observe()
        offset = rov.last("RC_CHANNELS_OVERRIDE").chan4_raw - 1500
        reported = math.copysign((abs(offset) - 20) / 380 * math.radians(45.0) * 3.375, offset)
        assert reported == pytest.approx(rate, abs=0.005)


def test_an_rovs_targets_keep_the_pilot_input_alive_at_neutral(rov: ScriptedVehicle) -> None:
    craft = connect(rov)
    craft.arm()
    craft.set_mode("ALT_HOLD")
    craft.send(HeadingTarget(psi=1.0))
    craft.session.pause(4.0)
    assert rov.last("SET_ATTITUDE_TARGET").type_mask == 0b1000111
    craft.send(DepthTarget(z=2.5))
    craft.observe()
    target = rov.last("SET_POSITION_TARGET_GLOBAL_INT")
    assert (target.alt, target.coordinate_frame, target.type_mask) == (-2.5, 6, 0b110111111011)
    assert rov.time - rov.overrides[3][1] < 0.2
    assert rov.overrides[3][0] == 1500


# --- arming, neutral, stopping --------------------------------------------------------------------------------


def test_a_boat_without_a_receiver_arms_because_neutral_overrides_flow_first(boat: ScriptedVehicle) -> None:
    boat.needs_overrides_to_arm = True
    craft = connect(boat)
    craft.arm()
    assert boat.armed
    assert boat.last("RC_CHANNELS_OVERRIDE").chan3_raw == 1500


def test_prearm_checks_that_settle_are_awaited(boat: ScriptedVehicle) -> None:
    craft = connect(boat)
    boat.arming_refusals = ["PreArm: Accels inconsistent"]
    craft.session.every(2.5, lambda: boat.arming_refusals.clear() if craft.clock.now() > begun + 2 else None)
    begun = craft.clock.now()
    craft.arm()
    assert boat.armed


def test_refused_arming_leaves_no_override_active(boat: ScriptedVehicle) -> None:
    craft = connect(boat)
    boat.arming_refusals = ["Arm: Leak detected"]
    with pytest.raises(ArmingRefused, match="Leak detected"):
        craft.arm()
    craft.session.pause(1.0)
    assert boat.overrides == {}


def test_neutral_is_verified_at_the_outputs_and_held_while_armed(flying: MavlinkCraft, boat: ScriptedVehicle) -> None:
    """Without a receiver ArduRover considers its pilot lost half a second after the last override."""
    flying.neutral()
    assert boat.servos[:3] == [1500, 1500, 1500]
    flying.session.pause(10.0)
    assert {n: pwm for n, (pwm, _) in boat.overrides.items()} == {1: 1500, 3: 1500}
    assert boat.time - boat.overrides[1][1] <= 0.1


@pytest.mark.parametrize("leave", ["disarm", "release"])
def test_leaving_releases_the_overrides_and_ends_all_commands(
    flying: MavlinkCraft, boat: ScriptedVehicle, leave: str
) -> None:
    flying.neutral()
    getattr(flying, leave)()
    before = boat.count("RC_CHANNELS_OVERRIDE")
    flying.session.pause(1.0)
    assert boat.overrides == {}
    assert (boat.last("RC_CHANNELS_OVERRIDE").chan1_raw, boat.last("RC_CHANNELS_OVERRIDE").chan3_raw) == (0, 0)
    assert boat.count("RC_CHANNELS_OVERRIDE") == before


def test_neutral_ends_the_autopilots_own_steering(flying: MavlinkCraft, boat: ScriptedVehicle) -> None:
    flying.set_mode("GUIDED")
    flying.send(HeadingTarget(psi=1.0, speed=1.0))
    flying.neutral()
    assert flying.mode == "HOLD"


def test_a_stuck_actuator_is_reported_with_its_value(flying: MavlinkCraft, boat: ScriptedVehicle) -> None:
    boat.on["RC_CHANNELS_OVERRIDE"] = lambda _: None
    boat.parameters["RC_OVERRIDE_TIME"] = 1e9
    with pytest.raises(NotAsFound, match=r"N \+0\.40 of full output"):
        flying.neutral()


def test_neutral_is_sent_even_when_the_link_is_lost(flying: MavlinkCraft, boat: ScriptedVehicle) -> None:
    boat.send = lambda message: None  # type: ignore[method-assign]
    with pytest.raises(LinkLost):
        flying.session.pause(20.0)
    with pytest.raises(LinkError):
        flying.neutral()
    boat.advance_to(boat.time + 0.1)
    assert boat.last("RC_CHANNELS_OVERRIDE").chan1_raw in (0, 1500)


@settings(max_examples=8, deadline=None)
@given(st.integers(0, 200))
def test_the_actuators_end_neutral_whenever_the_operator_stops(pumps: int) -> None:
    boat, left = ScriptedVehicle(), [10**9]

    def stop() -> bool:
        left[0] -= 1
        return left[0] < 0

    craft = connect(boat, stop)
    left[0] = pumps
    try:
        craft.arm()
        while True:
            craft.send(Actuate(N=0.4, X=0.5))
            craft.observe()
    except OperatorStopped:
        craft.neutral()
        with craft.shielded():
            craft.disarm()
            craft.session.pause(1.0)
    assert boat.servos[:3] == [1500, 1500, 1500]
    assert not boat.armed
    assert boat.overrides == {}


# --- recording --------------------------------------------------------------------------------


def test_a_trial_contains_its_vehicle(flying: MavlinkCraft) -> None:
    flying.start_recording("relay")
    for _ in range(50):
        flying.observe()
    trial = flying.stop_recording("aborted", "guard")
    assert (trial.name, trial.ending, trial.reason) == ("relay", "aborted", "guard")
    assert trial.meta["vehicle"]["version"] == "4.7.0-dev"
    assert len(trial["psi"]) == pytest.approx(50, abs=1)
    assert len(trial["N"]) == pytest.approx(125, abs=2)
    assert trial["N"].values.tolist() == pytest.approx([0.4] * len(trial["N"]), abs=0.01)


def test_the_same_flight_gives_a_bit_identical_record() -> None:
    def flight() -> Any:
        craft = connect(ScriptedVehicle())
        craft.arm()
        craft.start_recording("relay")
        for k in range(60):
            craft.observe()
            craft.send(Actuate(N=0.4 if k % 20 < 10 else -0.4))
        return craft.stop_recording("completed")

    first, second = flight(), flight()
    assert {"psi", "r", "N"} <= set(first.channels) == set(second.channels)
    for name, channel in first.channels.items():
        assert channel.t.tobytes() == second[name].t.tobytes()
        assert channel.values.tobytes() == second[name].values.tobytes()


def test_silence_is_a_lost_link_and_a_missing_attitude_alone_is_a_fault(boat: ScriptedVehicle) -> None:
    craft = open_craft(Session(MemoryLink(boat)))
    boat.mute.add("ATTITUDE")
    with pytest.raises(TelemetryFault, match="although the vehicle sends messages"):
        craft.observe()
    boat.alive = False
    with pytest.raises(LinkLost, match=r"Lost contact with .* \([23]\.\d s\)"):
        craft.observe()
