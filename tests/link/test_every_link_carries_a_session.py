"""The conformance suite of links, second half: a whole conversation over every transport and backend."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from link_ends import KINDS, RETURN, opened
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from scripted_vehicle import ScriptedVehicle
from vehicle_on_a_real_link import Afloat

from gcs_autotune.craft import Actuate
from gcs_autotune.errors import CommandDenied, LinkLost, OperatorStopped, ParameterMissing
from gcs_autotune.link import MemoryLink, Parameters, Rates, Session, Transport, open_craft, open_link
from gcs_autotune.link.transports import mavsdk as mavsdk_link
from gcs_autotune.link.transports import transport as returning

MEDIA = [*KINDS, *(f"mavsdk-{name}" for name in KINDS)]


class Aboard:
    """A vehicle, the link to it, and a session that has found it."""

    def __init__(self, link: Transport, boat: ScriptedVehicle | None) -> None:
        self.stop = False
        self.link, self.boat = link, boat
        self.session = Session(link, interrupt=lambda: self.stop)
        self.session.discover()


@pytest.fixture
def aboard(request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Aboard]:
    monkeypatch.setattr(returning, "_RETRY", 0.01)
    monkeypatch.setattr(mavsdk_link, "_CONNECT_PATIENCE", 0.02)
    boat = ScriptedVehicle()
    if request.param == "memory":
        yield Aboard(MemoryLink(boat), boat)
    elif request.param == "embedded":
        with open_link("sitl:charlie") as link:
            yield Aboard(link, None)
    else:
        for ends in opened(request.param, tmp_path):
            yield Aboard(Afloat(ends, boat), boat)


every = pytest.mark.parametrize("aboard", ["memory", "embedded", *MEDIA], indirect=True)
scripted = pytest.mark.parametrize("aboard", ["memory", *MEDIA], indirect=True)


@every
def test_parameters_commands_and_rates_work_over_every_link(aboard: Aboard) -> None:
    session = aboard.session
    parameters = Parameters(session)
    parameters.write("ATC_STR_RAT_P", 0.33)
    assert parameters.read("ATC_STR_RAT_P") == pytest.approx(0.33, rel=1e-6)
    with pytest.raises(ParameterMissing):
        parameters.read("NO_SUCH_NAME")
    everything = parameters.read_full()
    assert len(everything) > 80 and everything["ATC_STR_RAT_P"] == pytest.approx(0.33, rel=1e-6)
    craft = open_craft(session)
    with pytest.raises(CommandDenied) as denied:
        craft.commands.command_long(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, mavlink.MAVLINK_MSG_ID_ATTITUDE, 1000.0)
    assert denied.value.result == mavlink.MAV_RESULT_DENIED
    granted = Rates(session, craft.commands).request({"ATTITUDE": 50.0})
    assert 0.0 < granted["ATTITUDE"] <= 40.0
    assert session.port.bad_data == 0


@pytest.mark.slow
@every
def test_the_vehicle_can_be_armed_steered_brought_to_neutral_and_released(aboard: Aboard) -> None:
    craft = open_craft(aboard.session, arm_patience=40.0)
    craft.set_mode("MANUAL")
    craft.arm()
    assert craft.armed
    craft.send(Actuate(N=0.3))
    for _ in range(12):
        seen = craft.observe()
    assert seen.output["N"] == pytest.approx(0.3, abs=0.05)
    craft.neutral()
    assert abs(craft.telemetry.outputs["N"]) < 0.03
    craft.disarm()
    assert not craft.armed
    if aboard.boat is not None:
        released = aboard.boat.last("RC_CHANNELS_OVERRIDE")
        assert (released.chan1_raw, released.chan3_raw) == (0, 0)


@scripted
def test_messages_of_another_system_are_ignored(aboard: Aboard) -> None:
    assert aboard.boat is not None
    mode = aboard.session.custom_mode
    parameters = Parameters(aboard.session)
    aboard.boat.send_as(9, 1, mavlink.MAVLink_heartbeat_message(11, 3, 128, 7, 4, 3))
    aboard.boat.send_as(1, 7, mavlink.MAVLink_heartbeat_message(11, 3, 128, 8, 4, 3))
    aboard.boat.send_as(9, 1, mavlink.MAVLink_param_value_message(b"ATC_STR_RAT_P", 66.0, 9, 100, 3))
    aboard.session.pause(0.5)
    assert aboard.session.custom_mode == mode
    assert not aboard.session.armed
    assert aboard.session.routing.foreign[9, 1] >= 2
    assert parameters.read("ATC_STR_RAT_P") != 66.0


@scripted
def test_silence_is_a_lost_link_after_the_timeout(aboard: Aboard) -> None:
    assert aboard.boat is not None
    aboard.boat.alive = False
    with pytest.raises(LinkLost, match=r"Lost contact with .* \(5\.\d s\)"):
        aboard.session.pause(60.0)


@pytest.mark.parametrize("aboard", [name for name in RETURN if name in MEDIA], indirect=True)
def test_the_vehicles_return_can_be_awaited_after_a_break(aboard: Aboard) -> None:
    assert isinstance(aboard.link, Afloat)
    aboard.link.cut()
    with pytest.raises(LinkLost):
        aboard.session.pause(60.0)
    aboard.link.mend()
    aboard.link.follow_tick(aboard.link.clock.now(), 0.1)
    assert aboard.session.await_return(5.0)
    assert Parameters(aboard.session).read("ATC_STR_RAT_FF") == 0.75


@every
def test_the_operators_stop_is_raised(aboard: Aboard) -> None:
    aboard.stop = True
    with pytest.raises(OperatorStopped):
        aboard.session.pause(1.0)
