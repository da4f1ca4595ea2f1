"""Round trip, command to servo, the whole loop; rates fitted to a narrow link; rates kept against another station."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from narrow import Narrow
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from router import Router
from scripted_vehicle import ScriptedVehicle

from gcs_autotune.craft import Actuate
from gcs_autotune.errors import TelemetryFault
from gcs_autotune.link import MavlinkCraft, MemoryLink, Peer, Session, open_craft
from gcs_autotune.link.vehicle.bandwidth import Demand, plan
from sitl import open_vehicle

WANTED = {"ATTITUDE": 10.0, "SERVO_OUTPUT_RAW": 40.0, "RC_CHANNELS": 10.0, "GLOBAL_POSITION_INT": 10.0, "VFR_HUD": 5.0}
ALL = 10 * 40 + 40 * 33 + 10 * 54 + 10 * 40 + 5 * 32
"""Approximate bytes per second of these messages."""


def connect(peer: Peer) -> MavlinkCraft:
    return open_craft(Session(MemoryLink(peer)), wanted_rates=WANTED, arm_patience=3.0)


def oscillate(craft: MavlinkCraft, seconds: int) -> None:
    for k in range(10 * seconds):
        craft.observe()
        craft.send(Actuate(N=0.3 if k // 10 % 2 else -0.3))


# --- how late --------------------------------------------------------------------------------


@pytest.mark.parametrize("latency", [0.0, 0.06, 0.2])
def test_the_delays_of_a_link_are_measured(boat: ScriptedVehicle, latency: float) -> None:
    craft = connect(Narrow(boat, latency=latency))
    craft.arm()
    oscillate(craft, 10)
    times = craft.link_times
    assert times.round_trip == pytest.approx(2 * latency + 0.03, abs=0.05)
    assert times.command_to_servo == pytest.approx(latency + 0.02, abs=0.03)
    assert times.loop == pytest.approx(2 * latency + 0.02, abs=0.05)
    assert times.samples >= 10


def test_the_loop_delay_is_never_shorter_than_the_command_to_servo_delay(
    boat: ScriptedVehicle, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Over an uneven link the compared clocks place a command before the attitude that it responds to."""
    craft = connect(Narrow(boat, latency=0.06))
    craft.arm()
    vehicle_time = craft.latency.vehicle_time
    monkeypatch.setattr(craft.latency, "vehicle_time", lambda t: vehicle_time(t) - 0.5)
    oscillate(craft, 10)
    times = craft.link_times
    assert 0.0 < times.command_to_servo <= times.loop
    assert 0.0 < times.command_to_servo_90 <= times.loop_90
    assert str(times).startswith("from measured attitude to output")


def test_jitter_shows_in_the_90th_percentile(boat: ScriptedVehicle) -> None:
    craft = connect(Narrow(boat, latency=0.05, jitter=0.15))
    craft.arm()
    oscillate(craft, 20)
    times = craft.link_times
    assert times.loop_90 - times.loop > 0.03
    assert times.round_trip_90 - times.round_trip > 0.03


def test_the_delay_sets_the_shortest_period_that_can_be_flown(boat: ScriptedVehicle) -> None:
    craft = connect(Narrow(boat, latency=0.2))
    assert craft.least_period == pytest.approx(8 / 10.0, rel=0.1)
    craft.arm()
    assert craft.least_period == pytest.approx(8 * (0.42 + 0.05), rel=0.15)


def test_a_trial_contains_the_link_delays(boat: ScriptedVehicle) -> None:
    craft = connect(boat)
    craft.arm()
    craft.start_recording("relay")
    oscillate(craft, 3)
    meta = craft.stop_recording("completed").meta
    assert meta["link_times"]["override_rate"] >= 25.0
    assert {"round_trip", "command_to_servo", "loop"} <= set(meta["link_times"])
    assert (meta["loop_period"], meta["rate_lag"]) == (0.02, 0.0)


def test_a_vehicle_without_timesync_can_be_flown(boat: ScriptedVehicle) -> None:
    boat.on["TIMESYNC"] = lambda _: None
    craft = connect(boat)
    craft.arm()
    assert str(craft.link_times).startswith("from measured attitude to output")


# --- how much --------------------------------------------------------------------------------


def test_a_wide_link_gets_the_full_rates(boat: ScriptedVehicle) -> None:
    craft = connect(Narrow(boat, rate=11520.0))
    assert craft.rates.measured["SERVO_OUTPUT_RAW"] == pytest.approx(40.0, rel=0.1)
    assert not any("bytes/s" in note for note in craft.session.notes)


def test_a_narrow_link_carries_the_most_needed_messages(boat: ScriptedVehicle) -> None:
    pipe = Narrow(boat, rate=1100.0, latency=0.05, jitter=0.02)
    craft = connect(pipe)
    rates = craft.rates.measured
    assert rates["ATTITUDE"] == pytest.approx(10.0, rel=0.1)
    assert 10.0 <= rates["SERVO_OUTPUT_RAW"] < 30.0
    assert rates["VFR_HUD"] < 2.0
    assert any("the link carries" in note and "SERVO_OUTPUT_RAW 40 ->" in note for note in craft.session.notes)
    pipe.dropped = 0
    craft.arm()
    oscillate(craft, 10)
    assert pipe.dropped < 0.02 * pipe.carried
    assert 9.0 <= craft.link_times.override_rate <= 25.0, "the way up is spared too"


def connect_with_spare_rates(peer: Peer) -> MavlinkCraft:
    return open_craft(
        Session(MemoryLink(peer)), wanted_rates=WANTED, spare_rates={"SERVO_OUTPUT_RAW": 100.0}, arm_patience=3.0
    )


def test_outputs_are_requested_at_100_hz_from_a_fast_loop_and_40_hz_from_a_slow_one() -> None:
    for vehicle, rate in (("falcon", 100.0), ("charlie", 40.0)):
        craft = connect_with_spare_rates(open_vehicle(vehicle))
        assert craft.rates.granted["SERVO_OUTPUT_RAW"].granted == rate
        craft.rates.measure({})
        assert craft.rates.measured["SERVO_OUTPUT_RAW"] == pytest.approx(rate, rel=0.1)
        assert craft.rates.measured["ATTITUDE"] == pytest.approx(10.0, rel=0.1)


def test_a_link_without_spare_capacity_keeps_the_usual_rates() -> None:
    craft = connect_with_spare_rates(Narrow(open_vehicle("falcon"), rate=3600.0))
    assert craft.rates.granted["SERVO_OUTPUT_RAW"].granted == 40.0
    assert craft.rates.measured["SERVO_OUTPUT_RAW"] == pytest.approx(40.0, rel=0.1)
    assert craft.rates.measured["ATTITUDE"] == pytest.approx(10.0, rel=0.1)


RAW_IMU = mavlink.MAVLINK_MSG_ID_RAW_IMU


def chatting(boat: ScriptedVehicle) -> ScriptedVehicle:
    """Have *boat* send RAW_IMU at 20 Hz without a request, after all else, as an autopilot streams by default."""
    boat.intervals[RAW_IMU] = 0.05
    step = boat._step

    def with_chatter() -> None:
        step()
        interval = boat.intervals.get(RAW_IMU, -1.0)
        if interval > 0 and boat._is_due("RAW_IMU", interval):
            boat.send(mavlink.MAVLink_raw_imu_message(0, *range(1, 10)))

    boat._step = with_chatter  # type: ignore[method-assign]
    return boat


def test_unrequested_streams_are_turned_off_on_a_narrow_link_and_restored(boat: ScriptedVehicle) -> None:
    craft = connect(Narrow(chatting(boat), rate=1200.0))
    assert craft.rates.measured["ATTITUDE"] >= 4.5
    assert any("RAW_IMU off" in note for note in craft.session.notes)
    craft.rates.restore()
    assert boat.intervals[RAW_IMU] == pytest.approx(0.05)


@pytest.mark.parametrize(
    ("rate", "answers_by_name"),
    [*((rate, True) for rate in range(1100, 1501, 25)), *((rate, False) for rate in (1300, 1325, 1400, 1425))],
)
def test_messages_crowded_out_on_a_narrow_link_are_not_taken_for_missing(
    boat: ScriptedVehicle, rate: int, answers_by_name: bool
) -> None:
    """At this capacity attitudes and outputs alone fill the link, and three other messages never arrive."""
    if not answers_by_name:
        boat.asked_for = lambda number: number == mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION
    craft = connect(Narrow(chatting(boat), rate=rate))
    assert all(craft.rates.measured[name] > 0.5 for name in WANTED)
    assert any("the link carries" in note for note in craft.session.notes)


def test_an_unsupported_message_does_not_affect_the_others(boat: ScriptedVehicle) -> None:
    boat.mute.add("VFR_HUD")
    craft = connect(boat)
    assert craft.rates.measured["VFR_HUD"] == 0.0
    assert {n: g.granted for n, g in craft.rates.granted.items()} == WANTED
    assert boat.intervals[mavlink.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW] == pytest.approx(1.0 / WANTED["SERVO_OUTPUT_RAW"])
    assert not any("bytes/s" in note for note in craft.session.notes)


def test_the_status_report_of_a_radio_is_shown(boat: ScriptedVehicle) -> None:
    router = Router(boat, repeats=True)
    radio = mavlink.MAVLink(None, srcSystem=51, srcComponent=68)
    router.every(radio, 0.5, lambda: mavlink.MAVLink_radio_status_message(180, 150, 40, 20, 30, 7, 0))
    craft = connect(router)
    assert any(
        "radio: signal 180 and noise 20 here" in n and "40 % of its buffer free" in n for n in craft.session.notes
    )
    assert craft.other_stations.stations == {}


def test_a_link_too_narrow_for_the_minimum_is_refused_with_its_capacity(boat: ScriptedVehicle) -> None:
    lossy, slow = r"loses \d+ % of .* is overloaded", r"it carries \d+ bytes/s.* Use a faster link"
    with pytest.raises(TelemetryFault, match=f"{lossy}|{slow}"):
        connect(Narrow(boat, rate=250.0))


@settings(max_examples=50, deadline=None)
@given(st.floats(100.0, 20000.0), st.floats(0.0, 5000.0))
def test_a_plan_never_exceeds_the_capacity_except_for_the_minimum_rates(capacity: float, chatter: float) -> None:
    demands = [Demand("ATTITUDE", 10, 40, 5), Demand("SERVO_OUTPUT_RAW", 40, 33, 5), Demand("VFR_HUD", 5, 32)]
    rates, hushed = plan(demands, {"RAW_IMU": chatter}, capacity)
    used = sum(rates[d.name] * d.size for d in demands) + (0.0 if hushed else chatter)
    floors = sum(d.floor * d.size for d in demands)
    assert used <= max(0.8 * capacity, floors) + 1e-6
    assert all(d.floor <= rates[d.name] <= d.rate for d in demands)


# --- and whose --------------------------------------------------------------------------------


def test_rates_changed_by_another_station_are_requested_again_and_reported(boat: ScriptedVehicle) -> None:
    router = Router(boat, repeats=True)
    other = router.station(252)
    number = mavlink.MAVLINK_MSG_ID_ATTITUDE

    def stream(m: Any) -> None:
        boat.intervals[number] = 1.0 / m.req_message_rate

    boat.on["REQUEST_DATA_STREAM"] = stream
    craft = connect(router)
    craft.arm()
    router.say(other, mavlink.MAVLink_request_data_stream_message(1, 1, mavlink.MAV_DATA_STREAM_EXTRA1, 2, 1))
    oscillate(craft, 3)
    assert boat.intervals[number] == pytest.approx(0.1)
    notes = [note for note in craft.session.notes if "requested again" in note]
    assert len(notes) == 1
    assert notes[0].startswith("message rates were low and were requested again: ATTITUDE at")
    assert "GCS (system 252, component 190) sent REQUEST_DATA_STREAM" in notes[0]


def test_foreign_traffic_through_a_router_changes_nothing_recorded(boat: ScriptedVehicle) -> None:
    """Duplicated datagrams, foreign heartbeats and foreign traffic change nothing that is recorded."""
    router = Router(boat, repeats=True)
    other = router.station(252)
    router.every(other, 0.1, lambda: mavlink.MAVLink_attitude_message(1, 0.0, 0.0, 2.0, 0.0, 0.0, 9.0))
    craft = connect(router)
    craft.arm()
    craft.start_recording("relay")
    oscillate(craft, 5)
    trial = craft.stop_recording("completed")
    assert abs(trial["r"].values).max() < 1.0
    assert len(trial["psi"]) == pytest.approx(50, abs=2)
