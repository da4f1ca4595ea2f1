"""Other stations and a pilot on the same vehicle: the run stops and reports who it was."""

from __future__ import annotations

from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from router import Router
from scripted_vehicle import ROV, ScriptedVehicle

from gcs_autotune.clock import ManualClock
from gcs_autotune.craft import Actuate
from gcs_autotune.errors import GuardTripped, NotAsFound, PreconditionFailed, TelemetryFault
from gcs_autotune.link import MavlinkCraft, MemoryLink, Peer, Session, open_craft
from gcs_autotune.link.vehicle.latency import Latency
from gcs_autotune.link.vehicle.rc_monitor import RcMonitor
from gcs_autotune.link.vehicle.setpoint_streamer import SendRate


def connect(peer: Peer) -> MavlinkCraft:
    return open_craft(Session(MemoryLink(peer)), arm_patience=3.0)


def fly(craft: MavlinkCraft, ticks: int = 40) -> None:
    for k in range(ticks):
        craft.observe()
        craft.send(Actuate(N=0.3 if k // 10 % 2 else -0.3, X=0.2))


def trip(craft: MavlinkCraft, guard: str) -> str:
    with pytest.raises(GuardTripped) as caught:
        fly(craft)
    assert caught.value.guard == guard
    return str(caught.value)


@pytest.fixture
def router(boat: ScriptedVehicle) -> Router:
    return Router(boat)


@pytest.fixture
def flying(router: Router) -> MavlinkCraft:
    """An armed boat flown by this tool, with a second station (system 252) on the link."""
    router.other = router.station(252)  # type: ignore[attr-defined]
    return lone(router)


def order(system: int, command: int, *values: float) -> Any:
    return mavlink.MAVLink_command_long_message(system, 1, command, 0, *values, *[0.0] * (7 - len(values)))


# --- who did it --------------------------------------------------------------------------------


def test_a_silent_second_station_does_not_disturb(flying: MavlinkCraft) -> None:
    fly(flying, 200)
    assert flying.other_stations.stations == {(252, 190): "GCS"}


def test_a_mode_change_is_reported_with_the_station_that_ordered_it(flying: MavlinkCraft, router: Router) -> None:
    router.say(router.other, order(1, mavlink.MAV_CMD_DO_SET_MODE, 1, 4))  # type: ignore[attr-defined]
    said = trip(flying, "mode")
    assert "from MANUAL to HOLD, not by this tool" in said
    assert "GCS (system 252, component 190) sent MAV_CMD_DO_SET_MODE" in said


def lone(peer: Peer) -> MavlinkCraft:
    """An armed boat that only this tool flies."""
    craft = connect(peer)
    craft.arm()
    fly(craft)
    return craft


def pause(craft: MavlinkCraft, seconds: float) -> None:
    """Let this program pause for so long."""
    clock: Any = craft.clock
    clock.advance(seconds)


def alone(boat: ScriptedVehicle) -> MavlinkCraft:
    """The same without an RC receiver: then the radio failsafe acts two seconds after the last override."""
    boat.receiver = None
    return lone(boat)


def test_a_failsafe_after_our_own_pause_is_reported_as_caused_by_the_pause(boat: ScriptedVehicle) -> None:
    craft = alone(boat)
    boat.mode = 4
    boat.say("Radio Failsafe")
    pause(craft, 2.1)
    said = trip(craft, "pause")
    assert 'from MANUAL to HOLD (its message: "Radio Failsafe"): this computer paused for 2.1 s' in said
    assert "its radio failsafe does this after 2 s without overrides" in said and "no other station" not in said
    found = craft._interference.found
    assert found is not None and found.may_go_on and not found.stands


@pytest.mark.parametrize("paused", [0.0, 0.3, 0.6, 1.5])
@pytest.mark.parametrize("receiver", [True, False])
def test_a_hold_after_a_pause_too_short_for_a_failsafe_is_another_stations_order(
    boat: ScriptedVehicle, paused: float, receiver: bool
) -> None:
    """Its acknowledgement goes to that station alone, so no other station is detected."""
    craft = lone(boat) if receiver else alone(boat)
    boat.mode = 4
    pause(craft, paused)
    said = trip(craft, "mode")
    assert "from MANUAL to HOLD, not by this tool" in said and "no other station is on this link" in said
    assert ("pause of" in said) is (paused > 0.5)
    assert craft._interference.found is not None and craft._interference.found.mode_stands


def test_a_hold_after_a_long_pause_without_a_text_may_be_another_stations_order(boat: ScriptedVehicle) -> None:
    craft = alone(boat)
    boat.mode = 4
    pause(craft, 2.5)
    said = trip(craft, "mode")
    assert "The vehicle did not report a failsafe, so another station may have ordered this" in said
    found = craft._interference.found
    assert found is not None and found.mode_stands and not found.is_certain
    assert found.failsafe == "radio failsafe" and not found.has_reported


@pytest.mark.parametrize(("mode", "name"), [(5, "LOITER"), (11, "RTL")])
def test_a_mode_that_is_not_the_failsafes_was_ordered_by_another_station(
    boat: ScriptedVehicle, mode: int, name: str
) -> None:
    craft = alone(boat)
    boat.mode = mode
    boat.say("Radio Failsafe")
    pause(craft, 2.5)
    assert f"to {name}, not by this tool" in trip(craft, "mode")


def test_a_longer_failsafe_time_is_read_from_the_vehicle(boat: ScriptedVehicle) -> None:
    boat.parameters["FS_TIMEOUT"] = 4.0
    craft = alone(boat)
    boat.mode = 4
    pause(craft, 2.5)
    assert "not by this tool" in trip(craft, "mode")


def test_an_order_between_two_heartbeats_is_seen_before_ours_and_stays_in_force(boat: ScriptedVehicle) -> None:
    craft = lone(boat)
    boat.mode = 4
    with pytest.raises(GuardTripped, match="from MANUAL to HOLD, not by this tool"):
        craft.set_mode("GUIDED")
    assert boat.mode == 4


def test_an_order_just_after_ours_stays_in_force_although_both_arrive_at_once(boat: ScriptedVehicle) -> None:
    """Met on ArduSub 4.6: this computer paused, and the heartbeats of both modes came in one piece."""
    craft = lone(boat)
    craft.take_over()
    craft.set_mode("GUIDED")

    def obey_then_another(m: Any) -> None:
        boat._on_command_long(m)
        if m.command == mavlink.MAV_CMD_DO_SET_MODE:
            boat.heartbeat()
            boat.mode = 15
            boat.heartbeat()

    boat.on["COMMAND_LONG"] = obey_then_another
    with pytest.raises(GuardTripped, match="from MANUAL to GUIDED, not by this tool"):
        craft.set_mode("MANUAL")
    craft.neutral()
    assert (boat.mode, boat.armed) == (15, True)


def test_outputs_driven_by_a_mode_just_ordered_are_not_a_fault(boat: ScriptedVehicle) -> None:
    craft = lone(boat)
    craft.take_over()
    craft.set_mode("GUIDED")

    def obey_then_another(m: Any) -> None:
        boat._on_command_long(m)
        if m.command == mavlink.MAV_CMD_DO_SET_MODE:
            boat.heartbeat()
            boat.mode = 10
            boat._actuate = lambda: boat.servos.__setitem__(0, 1700)  # type: ignore[method-assign]

    boat.on["COMMAND_LONG"] = obey_then_another
    craft.neutral()
    assert (boat.mode, boat.armed) == (10, True)


def test_a_vehicle_put_into_a_mode_by_another_station_is_released(boat: ScriptedVehicle) -> None:
    craft = lone(boat)
    craft.take_over()
    craft.set_mode("GUIDED")
    boat.mode = 11
    trip(craft, "mode")
    craft.neutral()
    craft.session.pause(0.1)
    assert (boat.mode, boat.armed, boat.overrides) == (11, True, {})


def test_an_order_between_manoeuvres_is_detected(boat: ScriptedVehicle) -> None:
    craft = lone(boat)
    craft.take_over()
    craft.neutral()
    boat.mode = 4
    with pytest.raises(GuardTripped, match="not by this tool"):
        fly(craft)
    assert boat.mode == 4


def test_a_vehicle_that_is_armed_by_another_station_is_not_disarmed(boat: ScriptedVehicle) -> None:
    craft = connect(boat)
    craft.take_over()
    boat.armed = True
    found = craft.intervention()
    assert found is not None and found.armed_stands and "the vehicle was armed, not by this tool" in found.what


def test_a_late_copy_of_our_own_command_is_recognised_by_its_second_acknowledgement(boat: ScriptedVehicle) -> None:
    craft = lone(boat)
    craft.take_over()
    craft.set_mode("GUIDED")
    craft.set_mode("MANUAL")
    craft.set_mode("GUIDED")
    copy = next(m for m in boat.heard if m.get_type() == "COMMAND_LONG" and m.command == 176 and m.param2 == 0)
    boat._on_command_long(copy)
    assert "a late copy of this tool's own command" in trip(craft, "mode")
    assert craft._interference.found is not None and not craft._interference.found.stands


def test_a_restart_is_reported_even_when_only_heartbeats_arrive(boat: ScriptedVehicle) -> None:
    craft = lone(boat)
    craft.session.pause(10.0)
    boat.intervals.clear()
    boat.armed, boat.mode = False, 4
    boat.boot_offset = -boat.time
    with pytest.raises(TelemetryFault, match="the autopilot has restarted: its time since boot went from"):
        fly(craft)


def test_the_check_for_a_restart_ends_with_its_answer(boat: ScriptedVehicle) -> None:
    craft = lone(boat)
    boat.intervals.clear()
    craft.session.pause(1.0)
    begun = craft.clock.now()
    craft.check_restart()
    assert craft.clock.now() - begun < 0.5


def test_a_failsafe_that_the_vehicle_reports_is_not_attributed_to_another_station(boat: ScriptedVehicle) -> None:
    """ArduRover 4.5 sent these texts when its stock boat spun at full rudder."""
    craft = lone(boat)
    boat.say("EKF variance")
    boat.say("EKF failsafe")
    boat.mode = 4
    said = trip(craft, "mode")
    assert '(its message: "EKF variance"; "EKF failsafe"): the ' in said
    assert "the vehicle's own failsafe did this. Fix its cause" in said
    assert "no other station" not in said


def test_a_failsafe_reported_without_our_pause_is_reported_as_a_failsafe(rov: ScriptedVehicle) -> None:
    """Its text does not contain the word failsafe."""
    rov.receiver = None
    rov.parameters.update(FS_PILOT_INPUT=2.0, FS_PILOT_TIMEOUT=1.0)
    craft = connect(rov)
    craft.arm()
    for _ in range(10):
        craft.observe()
        craft.send(Actuate(N=0.1))
    rov.say("Lost manual control")
    rov.armed = False
    said = trip(craft, "armed")
    assert "it reports its pilot input failsafe, which does this after 1 s without overrides" in said
    assert "lost on the link" in said and "no other station" not in said


def test_an_observed_order_takes_precedence_over_a_failsafe(flying: MavlinkCraft, router: Router) -> None:
    router.say(router.other, order(1, mavlink.MAV_CMD_DO_SET_MODE, 1, 4))  # type: ignore[attr-defined]
    router.vehicle.say("EKF failsafe")  # type: ignore[attr-defined]
    assert "sent MAV_CMD_DO_SET_MODE" in trip(flying, "mode")


def test_a_pause_long_ago_is_not_a_cause(boat: ScriptedVehicle) -> None:
    craft = alone(boat)
    pause(craft, 2.2)
    fly(craft, 60)
    boat.mode = 4
    assert "no other station is on this link" in trip(craft, "mode")


def test_an_observed_order_takes_precedence_over_our_pause(flying: MavlinkCraft, router: Router) -> None:
    router.say(router.other, order(1, mavlink.MAV_CMD_DO_SET_MODE, 1, 4))  # type: ignore[attr-defined]
    pause(flying, 0.7)
    assert "sent MAV_CMD_DO_SET_MODE" in trip(flying, "mode")


def test_a_pause_counts_in_the_time_of_a_faster_vehicle() -> None:
    clock = ManualClock()
    send_rate = SendRate(clock)
    for k in range(50):
        clock.advance_to(0.04 * k)
        send_rate.count(100.0 + 0.4 * k)
    clock.advance(0.36)
    send_rate.count(120.0)
    assert send_rate.pause_since(1.9) == pytest.approx(0.36) and send_rate.pause_since(2.4) == 0.0
    assert send_rate.pace == pytest.approx(10.0, rel=0.2)


def test_a_disarm_is_reported_with_the_station_that_ordered_it(flying: MavlinkCraft, router: Router) -> None:
    router.say(router.other, order(1, mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0))  # type: ignore[attr-defined]
    assert "GCS (system 252, component 190) sent MAV_CMD_COMPONENT_ARM_DISARM" in trip(flying, "armed")


def test_a_foreign_parameter_write_is_reported_with_the_stations_present(flying: MavlinkCraft, router: Router) -> None:
    flying.parameters.watch({"WP_SPEED": 2.0})
    router.say(router.other, mavlink.MAVLink_param_set_message(1, 1, b"WP_SPEED", 8.0, 9))  # type: ignore[attr-defined]
    said = trip(flying, "parameters")
    assert "WP_SPEED = 8" in said and "also on this link: GCS (system 252, component 190)" in said


def test_a_foreign_parameter_write_is_reported_with_its_sender_on_a_broadcast_link(boat: ScriptedVehicle) -> None:
    router = Router(boat, repeats=True)
    other = router.station(42, 25)
    craft = connect(router)
    craft.arm()
    craft.parameters.watch({"WP_SPEED": 2.0})
    router.say(other, mavlink.MAVLink_param_set_message(1, 1, b"WP_SPEED", 8.0, 9))
    assert "GCS (system 42, component 25) sent PARAM_SET" in trip(craft, "parameters")


# --- operator control ---------------------------------------------------------------------------

FORMS = {
    "as it is": (21, lambda station, flags: bytes([flags, station])),
    "as it was": (184, lambda s, f: bytes([s, f])),
}


class UnknownMessage:
    """A message that pymavlink does not have, as the vehicle sends it."""

    def __init__(self, number: int, extra: int, payload: bytes, *, damaged: bool = False) -> None:
        self._number, self._extra, self._damaged = number, extra, damaged
        self._payload = payload.rstrip(b"\0") or b"\0"

    def get_type(self) -> str:
        return f"UNKNOWN_{self._number}"

    def pack(self, mav: Any) -> bytes:
        number = self._number.to_bytes(3, "little")
        head = bytes([len(self._payload), 0, 0, mav.seq, mav.srcSystem, mav.srcComponent, *number])
        mav.seq = (mav.seq + 1) % 256
        crc = mavlink.x25crc(head + self._payload + bytes([self._extra])).crc ^ self._damaged
        return b"\xfd" + head + self._payload + crc.to_bytes(2, "little")


def control_status(station: int, flags: int = 1, form: str = "as it is", *, damaged: bool = False) -> UnknownMessage:
    extra, make = FORMS[form]
    return UnknownMessage(512, extra, make(station, flags), damaged=damaged)


def manual_input(source: int, system: int = 0, component: int = 0, *, damaged: bool = False) -> UnknownMessage:
    return UnknownMessage(515, 128, bytes([source, system, component]), damaged=damaged)


@pytest.mark.parametrize("form", list(FORMS))
def test_the_station_in_control_is_reported_with_an_override_conflict(boat: ScriptedVehicle, form: str) -> None:
    router = Router(boat)
    other = router.station(252)
    craft = lone(router)
    assert craft.other_stations.in_control is None
    boat.send(control_status(252, form=form))
    fly(craft)
    assert any("GCS (system 252, component 190) is in control of it" in note for note in craft.session.notes)
    assert any("that station keeps control" in note for note in craft.session.notes)
    boat.on["MANUAL_CONTROL"] = lambda m: boat.overrides.update({1: (1500 + m.y // 2, boat.time)})
    router.every(other, 0.034, lambda: mavlink.MAVLink_manual_control_message(1, 0, 400, 0, 0, 0))
    said = trip(craft, "sticks")
    assert "the vehicle reports that GCS (system 252, component 190) is in control of it (CONTROL_STATUS)" in said


def test_own_or_damaged_control_status_is_ignored_and_lost_control_is_reported(flying: MavlinkCraft, boat: Any) -> None:
    boat.send(control_status(252, damaged=True))
    boat.send(control_status(255))
    fly(flying)
    assert not any("in control" in note for note in flying.session.notes)
    boat.send(control_status(0))
    fly(flying)
    assert any("no station is in control of it now" in note for note in flying.session.notes)
    boat.send(control_status(252, flags=3))
    fly(flying)
    assert any("releases control on request" in note for note in flying.session.notes)
    boat.mode = 4
    assert "reports that GCS (system 252, component 190) is in control" in trip(flying, "mode")


def test_the_station_that_steers_is_reported_with_an_override_conflict(flying: MavlinkCraft, boat: Any) -> None:
    boat.send(manual_input(2, 252, 190))
    fly(flying)
    assert any("GCS (system 252, component 190) steers it (MANUAL_INPUT_STATUS)" in n for n in flying.session.notes)
    boat.on["RC_CHANNELS_OVERRIDE"] = lambda _: None
    boat.overrides.update({1: (1700, boat.time + 60.0)})
    said = trip(flying, "sticks")
    assert "reports that GCS (system 252, component 190) steers it (MANUAL_INPUT_STATUS)" in said


def test_a_station_with_our_system_id_is_distinguished_by_its_component(flying: MavlinkCraft, boat: Any) -> None:
    boat.send(manual_input(2, 255, 100))
    fly(flying)
    assert any("(system 255, component 100) steers it" in note for note in flying.session.notes)


def test_steering_by_the_vehicles_receiver_is_reported_when_our_overrides_stop_arriving(
    flying: MavlinkCraft, boat: ScriptedVehicle
) -> None:
    boat.send(manual_input(1))
    fly(flying)
    boat.on["RC_CHANNELS_OVERRIDE"] = lambda _: None
    boat.parameters["RC_OVERRIDE_TIME"] = 1.0
    assert "the vehicle reports that its own RC receiver steers it (MANUAL_INPUT_STATUS)" in trip(flying, "sticks")


def test_own_or_damaged_manual_input_status_is_ignored(flying: MavlinkCraft, boat: Any) -> None:
    boat.send(manual_input(2, 252, 190, damaged=True))
    boat.send(manual_input(2, 255, 190))
    fly(flying)
    assert not any("steers it" in note for note in flying.session.notes)
    boat.mode = 4
    assert "steers it" not in trip(flying, "mode")


def test_another_stations_request_for_control_is_reported_and_not_granted(flying: MavlinkCraft, boat: Any) -> None:
    boat.send(order(255, 32100, 1, 0, 10, 252))
    fly(flying)
    assert any("(system 252, component 190) requests control" in note for note in flying.session.notes)
    assert not any(m.get_type() == "COMMAND_LONG" and m.command == 32100 for m in boat.heard)


def test_commands_to_another_vehicle_are_ignored(boat: ScriptedVehicle) -> None:
    router = Router(boat, repeats=True)
    other = router.station(42, 25)
    craft = connect(router)
    router.say(other, mavlink.MAVLink_param_set_message(7, 1, b"WP_SPEED", 8.0, 9))
    craft.observe()
    assert not craft.other_stations.orders


# --- sticks --------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["RC_CHANNELS_OVERRIDE", "MANUAL_CONTROL"])
def test_another_stations_joystick_trips_the_guard(boat: ScriptedVehicle, kind: str) -> None:
    """It has to be the vehicle's own system id, 255, or the vehicle would not listen to it."""
    router = Router(boat, repeats=True)
    twin = router.station(255, 100)
    boat.on["MANUAL_CONTROL"] = lambda m: boat.overrides.update({1: (1500 + m.y // 2, boat.time)})
    craft = lone(router)
    stick = mavlink.MAVLink_rc_channels_override_message(1, 1, 1700, *[65535] * 7)
    joystick = mavlink.MAVLink_manual_control_message(1, 0, 400, 0, 0, 0)
    router.every(twin, 0.034, lambda: stick if kind == "RC_CHANNELS_OVERRIDE" else joystick)
    said = trip(craft, "sticks")
    assert "RC channel 1 shows 1700 us, but" in said
    assert f"GCS (system 255, component 100) sent {kind}" in said
    assert any("also has system id 255" in note for note in craft.session.notes)


@pytest.mark.parametrize(("every", "is_seen"), [(3, True), (20, False)])
def test_a_conflict_in_one_message_of_three_is_detected_and_a_single_one_is_ignored(
    boat: ScriptedVehicle, every: int, is_seen: bool
) -> None:
    rc_monitor = RcMonitor(Session(MemoryLink(boat)))
    for n in range(60):
        rc_monitor.sent({1: 1500, 3: 1700})
        shown = [1560 if n % every == 0 else 1500, 0, 1700, *[0] * 15]
        rc_monitor._on_rc_channels(mavlink.MAVLink_rc_channels_message(n, 18, *shown, 0))
    assert rc_monitor.departed == ((1, 1500, 1560) if is_seen else None)


def test_a_pilot_who_moves_an_undriven_stick_trips_the_guard(flying: MavlinkCraft, boat: ScriptedVehicle) -> None:
    assert boat.receiver is not None
    boat.receiver[6] = 1850
    said = trip(flying, "sticks")
    assert "RC channel 6, which this tool does not drive, went from 1500 to 1850 us" in said
    assert "its RC transmitter, or overrides of another station with system id 255" in said


def test_the_mode_switch_of_the_transmitter_is_reported(flying: MavlinkCraft, boat: ScriptedVehicle) -> None:
    """RC_CHANNELS comes ten times as often as the heartbeat that shows the mode."""
    assert boat.receiver is not None
    boat.receiver[8], boat.mode = 1900, 4
    with pytest.raises(GuardTripped) as caught:
        fly(flying)
    said = str(caught.value)
    assert "RC channel 8" in said and "from 1500 to 1900 us" in said


def test_overrides_that_stop_arriving_trip_the_guard(flying: MavlinkCraft, boat: ScriptedVehicle) -> None:
    boat.on["RC_CHANNELS_OVERRIDE"] = lambda _: None
    boat.parameters["RC_OVERRIDE_TIME"] = 1.0
    assert "overrides of this tool do not reach the vehicle" in trip(flying, "sticks")


class Late(Router):
    """A router that holds everything of ours back for ``delay`` [s]."""

    delay = 0.0

    def __init__(self, vehicle: ScriptedVehicle) -> None:
        super().__init__(vehicle)
        self.held: list[tuple[float, bytes]] = []

    def receive(self, data: bytes) -> None:
        self.held.append((self.vehicle.time + self.delay, data))

    def advance_to(self, t: float) -> bytes:
        out = b""
        while self.vehicle.time + 0.02 <= t + 1e-9:
            while self.held and self.held[0][0] <= self.vehicle.time:
                self.vehicle.receive(self.held.pop(0)[1])
            out += super().advance_to(self.vehicle.time + 0.02)
        return out


@pytest.mark.parametrize(
    ("delay", "lateness", "words"),
    [
        (1.3, None, "commands of this tool arrive late"),
        (2.0, None, "commands of this tool arrive late"),
        (1.5, 0.1, "stalled for 1."),
    ],
)
def test_our_own_late_commands_are_not_attributed_to_another_sender(
    boat: ScriptedVehicle, monkeypatch: pytest.MonkeyPatch, delay: float, lateness: float | None, words: str
) -> None:
    """In the last case the vehicle, or the link, stalled for a second and a half, and is prompt when it is asked."""
    if lateness is not None:
        monkeypatch.setattr(Latency, "lateness", lateness)
    link = Late(boat)
    craft = lone(link)
    link.delay = delay
    with pytest.raises(GuardTripped) as caught:
        for k in range(120):
            craft.observe()
            craft.send(Actuate(N=0.3 if k // 30 % 2 else -0.3))
    said = str(caught.value)
    assert caught.value.guard == "late"
    assert words in said and "of another sender" not in said


def test_stick_values_we_sent_earlier_are_foreign_on_a_fast_link(boat: ScriptedVehicle) -> None:
    router = Router(boat)
    twin = router.station(255, 100)
    craft = lone(router)
    stick = mavlink.MAVLink_rc_channels_override_message(1, 1, 1500, 65535, 1500, *[65535] * 5)
    router.every(twin, 0.034, lambda: stick)
    assert "overrides of another sender are active" in trip(craft, "sticks")


def test_a_foreign_override_on_another_channel_is_detected_without_a_receiver(boat: ScriptedVehicle) -> None:
    router = Router(boat)
    twin = router.station(255, 100)
    boat.receiver = None
    craft = lone(router)
    router.every(
        twin, 0.1, lambda: mavlink.MAVLink_rc_channels_override_message(1, 1, *[65535] * 5, 1850, 65535, 65535)
    )
    said = trip(craft, "sticks")
    assert (
        "RC channel 6, which this tool does not drive, went from 1500 to 1850 us: overrides of another sender" in said
    )
    assert "pilot" not in said


# --- deaf --------------------------------------------------------------------------------


def refused(craft: MavlinkCraft) -> str:
    with pytest.raises(PreconditionFailed) as caught:
        craft.arm()
    return str(caught.value)


def test_a_vehicle_that_obeys_another_system_is_not_armed(boat: ScriptedVehicle) -> None:
    craft = connect(boat)
    boat.parameters["MAV_GCS_SYSID"] = 42
    said = refused(craft)
    assert "RC_CHANNELS shows channel 1 1500 us for 1508" in said
    assert "MAV_GCS_SYSID is 42, but this tool's system id is 255. Use --source-system 42" in said
    assert not boat.armed
    assert boat.overrides == {}


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"RC_OPTIONS": 34}, "RC_OPTIONS is 34: its bit 1"),
        ({"RC_OVERRIDE_TIME": 0}, "RC_OVERRIDE_TIME is 0"),
        ({"RC7_OPTION": 46}, "RC7_OPTION is 46: this transmitter switch disables overrides"),
        ({"MAV_OPTIONS": 1}, "MAV_OPTIONS bit 0 is set"),
        ({}, "its parameters show no reason"),
    ],
)
def test_the_reason_for_ignored_overrides_is_read_from_the_parameters(
    boat: ScriptedVehicle, changes: dict[str, float], words: str
) -> None:
    craft = connect(boat)
    boat.on["RC_CHANNELS_OVERRIDE"] = lambda _: None
    boat.parameters |= changes
    assert words in refused(craft)
    assert not boat.armed


def test_a_vehicle_that_receives_nothing_has_a_broken_uplink(boat: ScriptedVehicle) -> None:
    craft = connect(boat)
    boat.receive = lambda data: None  # type: ignore[method-assign]
    assert "the uplink is broken" in refused(craft)


def test_outputs_that_do_not_follow_are_detected_before_anything_is_flown(boat: ScriptedVehicle) -> None:
    craft = connect(boat)
    boat.servos[0], boat._actuate = (
        1500,
        lambda: boat.rc.__setitem__(  # type: ignore[method-assign]
            slice(1, 9), [boat.overrides.get(n, (1500, 0.0))[0] for n in range(1, 9)]
        ),
    )
    said = refused(craft)
    assert "+5% was sent, RC_CHANNELS shows the overrides, but SERVO_OUTPUT_RAW shows +0% in MANUAL" in said
    assert "safety switch" in said
    craft.session.pause(0.1)
    assert boat.overrides == {}


def test_a_boat_without_rc_channels_is_checked_by_its_outputs(boat: ScriptedVehicle) -> None:
    boat.mute.add("RC_CHANNELS")
    craft = connect(boat)
    craft.arm()
    assert any("sends no RC_CHANNELS" in note for note in craft.session.notes)


def test_options_that_forbid_overrides_are_rejected_on_connection(boat: ScriptedVehicle) -> None:
    boat.parameters["RC_OPTIONS"] = 34
    with pytest.raises(PreconditionFailed, match="Set it to 32"):
        connect(boat)


# --- channels --------------------------------------------------------------------------------


def test_remapped_channels_are_driven(boat: ScriptedVehicle) -> None:
    boat.parameters |= {"RCMAP_ROLL": 4, "RCMAP_THROTTLE": 2}
    boat._actuate = lambda: None  # type: ignore[method-assign]
    craft = connect(boat)
    craft.send(Actuate(X=0.5))
    craft.observe()
    message = boat.last("RC_CHANNELS_OVERRIDE")
    assert (message.chan4_raw, message.chan2_raw, message.chan1_raw) == (1500, 1765, 65535)


def test_a_rovs_pitch_and_roll_sticks_are_held_neutral(rov: ScriptedVehicle) -> None:
    """Without a receiver a channel keeps its last value for ever, be it a joystick's that was unplugged."""
    rov.receiver, rov.rc[1] = None, 1650
    craft = connect(rov)
    craft.arm()
    assert rov.rc[1] == 1500


def make_older(rov: ScriptedVehicle) -> None:
    """Make it an ArduSub 4.5 or 4.6: no RCMAP_*; the throttle stick counts from its trim at the low end."""
    for name in [n for n in rov.parameters if n.startswith("RCMAP_")]:
        del rov.parameters[name]
    rov.parameters["RC3_TRIM"] = 1100


def test_an_older_rovs_throttle_stick_is_neutral_at_mid_travel(rov: ScriptedVehicle) -> None:
    make_older(rov)
    rov._actuate = lambda: None  # type: ignore[method-assign]
    craft = connect(rov)
    for down, pwm in ((0.5, 1300), (0.0, 1500), (-1.0, 1900)):
        craft.send(Actuate(Z=down))
        craft.observe()
        assert rov.last("RC_CHANNELS_OVERRIDE").chan3_raw == pwm


@pytest.mark.parametrize(
    ("name", "value", "cure"),
    [("RC3_TRIM", 1500, ""), ("RC3_TRIM", 1110, ""), ("RC3_REVERSED", 1, ", RC3_REVERSED 0")],
)
def test_an_older_rov_without_neutral_throttle_at_mid_travel_is_refused(
    rov: ScriptedVehicle, name: str, value: float, cure: str
) -> None:
    """Such an ROV would dive at full thrust with the stick at 1500."""
    make_older(rov)
    rov.parameters[name] = value
    with pytest.raises(PreconditionFailed, match=f"Set RC3_TRIM 1100{cure} and try again"):
        connect(rov)


def test_an_older_rovs_pitch_and_roll_sticks_are_held_neutral(rov: ScriptedVehicle) -> None:
    """Pitch is channel 1 there, roll channel 2."""
    make_older(rov)
    rov.receiver, rov.rc[1], rov.rc[2] = None, 1600, 1650
    craft = connect(rov)
    craft.arm()
    assert (rov.rc[1], rov.rc[2]) == (1500, 1500)


def test_a_release_without_effect_is_reported(flying: MavlinkCraft, boat: ScriptedVehicle) -> None:
    flying.neutral()
    built_in = boat._on_rc_channels_override

    def deaf_to_zero(m: Any) -> None:
        if m.chan1_raw:
            built_in(m)

    boat.on["RC_CHANNELS_OVERRIDE"] = deaf_to_zero
    boat.parameters["RC_OVERRIDE_TIME"] = 1e9
    with pytest.raises(NotAsFound, match="still shows them"):
        flying.release()


def test_an_rov_is_neutral_after_disarming() -> None:
    rov = ScriptedVehicle(ROV)
    rov.receiver = None
    craft = connect(rov)
    craft.arm()
    craft.neutral()
    craft.disarm()
    assert rov.servos[:3] == [1500, 1500, 1500]
