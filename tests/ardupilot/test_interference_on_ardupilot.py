"""Overrides and interference with unmodified ArduRover and ArduSub, a second station on the same link."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest
from firmware_process import KINDS, ArduPilot, binary_of
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs_autotune.craft import Actuate
from gcs_autotune.errors import AutotuneError, GuardTripped, PreconditionFailed
from gcs_autotune.link import WANTED_RATES, MavlinkCraft, Session, open_craft, open_link
from gcs_autotune.link.vehicle.other_stations import OtherStations

pytestmark = [pytest.mark.ardupilot, pytest.mark.timeout(300)]

RATES = {**WANTED_RATES, "SERVO_OUTPUT_RAW": 40.0}
OTHER = 42


@pytest.fixture(scope="module", params=["rover", "sub"])
def firmware(request: pytest.FixtureRequest) -> Iterator[ArduPilot]:
    kind = KINDS[request.param]
    binary = binary_of(kind)
    if binary is None:
        pytest.skip(f"{kind.variable} is not set")
    with ArduPilot(kind, binary, speedup=2.0) as running:
        running.witness().close()
        yield running


@pytest.fixture
def craft(firmware: ArduPilot) -> Iterator[MavlinkCraft]:
    """Armed, and proved to obey."""
    with Session(open_link(firmware.uri)) as session:
        session.discover(30.0)
        craft = open_craft(session, wanted_rates=RATES, arm_patience=60.0)
        craft.arm()
        yield craft
        try:
            craft.neutral()
            craft.disarm()
        except AutotuneError:
            craft.release()
        craft.rates.restore()


def send_as(craft: MavlinkCraft, system: int, message: Any) -> None:
    """Send *message* as another station, through the same router."""
    craft.session.transport.write(message.pack(mavlink.MAVLink(None, srcSystem=system, srcComponent=25)))


def fly(craft: MavlinkCraft, ticks: int = 60) -> None:
    for k in range(ticks):
        craft.observe()
        craft.send(Actuate(N=0.2 if k // 10 % 2 else -0.2))


def trip(craft: MavlinkCraft, guard: str) -> str:
    with pytest.raises(GuardTripped) as caught:
        fly(craft)
    assert caught.value.guard == guard
    return str(caught.value)


def order(command: int, *values: float) -> Any:
    return mavlink.MAVLink_command_long_message(1, 1, command, 0, *values, *[0.0] * (7 - len(values)))


def test_arming_proves_that_the_vehicle_obeys_and_measures_the_loop_delay(craft: MavlinkCraft) -> None:
    fly(craft, 60)
    times = craft.link_times
    assert 0.0 < times.loop < 0.3
    assert times.samples >= 8
    assert times.override_rate >= 10.0, "25 on an idle machine"
    assert 0.0 < craft.least_period < 3.0


def test_a_foreign_mode_change_is_reported_with_its_sender(craft: MavlinkCraft) -> None:
    fly(craft, 10)
    send_as(craft, OTHER, order(mavlink.MAV_CMD_DO_SET_MODE, 1, 4 if craft.firmware.kind == "boat" else 0))
    assert f"(system {OTHER}, component 25) sent MAV_CMD_DO_SET_MODE" in trip(craft, "mode")


def test_a_foreign_disarm_is_reported_with_its_sender(craft: MavlinkCraft) -> None:
    fly(craft, 10)
    send_as(craft, OTHER, order(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0, 21196))
    assert f"(system {OTHER}, component 25) sent MAV_CMD_COMPONENT_ARM_DISARM" in trip(craft, "armed")


def test_a_foreign_write_to_a_watched_parameter_trips_the_guard(craft: MavlinkCraft) -> None:
    name = "INS_GYRO_FILTER"
    old = craft.parameters.read(name)
    craft.parameters.watch({name: old})
    fly(craft, 10)
    send_as(craft, OTHER, mavlink.MAVLink_param_set_message(1, 1, name.encode(), old + 1.0, 9))
    assert f"wrote {name} = {old + 1:g} (it was {old:g})" in trip(craft, "parameters")
    craft.parameters.unwatch([name])
    craft.parameters.intrusions.clear()
    craft.parameters.write(name, old)


def test_another_joystick_with_our_system_id_trips_the_guard(craft: MavlinkCraft) -> None:
    fly(craft, 10)
    joystick = mavlink.MAVLink_manual_control_message(1, 0, 300, 0 if craft.firmware.kind == "boat" else 500, 300, 0)
    craft.session.every(0.03, lambda: send_as(craft, 255, joystick))
    assert "overrides of another sender are active" in trip(craft, "sticks")


def test_rates_changed_by_another_station_are_requested_again(craft: MavlinkCraft) -> None:
    fly(craft, 10)
    everything = mavlink.MAV_DATA_STREAM_EXTRA1
    send_as(craft, OTHER, mavlink.MAVLink_request_data_stream_message(1, 1, everything, 2, 1))
    fly(craft, 60)
    begun = craft.telemetry.t
    fly(craft, 30)
    assert craft.telemetry.t - begun == pytest.approx(3.0, abs=0.7)


def test_a_run_on_another_computer_is_detected_through_the_autopilot(firmware: ArduPilot, craft: MavlinkCraft) -> None:
    """ArduPilot passes a HEARTBEAT on only to links on which its sender's ids were never received."""
    craft.session.at_work = True
    with Session(open_link(f"tcp:127.0.0.1:{5762 + 10 * firmware.instance}")) as second:
        second.discover(30.0)
        others = OtherStations(second)
        seen = second.wait_for(lambda: craft.session.pause(0.1) or others.at_work or None, 10.0)
    craft.session.at_work = False
    assert seen == f"GCS (system 255, component {craft.session.beacon})"


def test_a_vehicle_that_obeys_another_system_is_not_armed(firmware: ArduPilot) -> None:
    with Session(open_link(firmware.uri)) as session:
        session.discover(30.0)
        craft = open_craft(session, wanted_rates=RATES)
        name, obeyed = craft.parameters.read_first(craft.firmware.gcs_id_parameters)
        craft.parameters.write(name, OTHER)
        try:
            with pytest.raises(PreconditionFailed, match=f"{name} is {OTHER}, but this tool's system id is 255"):
                craft.arm()
            assert not craft.armed
        finally:
            craft.parameters.write(name, obeyed)
            craft.rates.restore()


def test_without_a_receiver_the_vehicle_stays_armed_in_its_mode_between_manoeuvres(craft: MavlinkCraft) -> None:
    craft.parameters.write("SIM_RC_FAIL", 1)
    try:
        fly(craft, 10)
        craft.neutral()
        before = craft.observe()
        craft.session.pause(5.0)
        after = craft.observe()
        assert (after.mode, after.armed) == (before.mode, before.armed)
        assert after.armed
    finally:
        craft.parameters.write("SIM_RC_FAIL", 0)
