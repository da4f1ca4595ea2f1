from __future__ import annotations

from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from scripted_vehicle import ScriptedVehicle

from gcs_autotune.errors import ArmingRefused, CommandDenied, LinkLost, ModeRefused, NoReply, UnknownName
from gcs_autotune.firmware import FIRMWARE
from gcs_autotune.link import Commands, MemoryLink, Session

STEER = 4321


@pytest.fixture
def commands(session: Session) -> Commands:
    return Commands(session, FIRMWARE["ardurover"])


def answering(boat: ScriptedVehicle, *results: int) -> None:
    """Make the boat answer COMMAND_LONGs with these results, one each, and none after them."""
    left = list(results)

    def answer(m: Any) -> None:
        if left:
            boat.acknowledge(m, left.pop(0))

    boat.on["COMMAND_LONG"] = answer


def test_a_command_is_sent_with_its_values(commands: Commands, boat: ScriptedVehicle) -> None:
    answering(boat, 0)
    commands.command_long(STEER, 1.0, 2.0)
    sent = boat.last("COMMAND_LONG")
    assert (sent.command, sent.param1, sent.param2, sent.param7) == (STEER, 1.0, 2.0, 0.0)


def test_an_unanswered_command_is_repeated_with_a_higher_confirmation(
    commands: Commands, boat: ScriptedVehicle
) -> None:
    answering(boat)
    before = boat.count("COMMAND_LONG")
    with pytest.raises(NoReply, match=r"within 4\.5 s"):
        commands.command_long(STEER)
    sent = [m.confirmation for m in boat.heard if m.get_type() == "COMMAND_LONG"][before:]
    assert sent == [0, 1, 2]


@pytest.mark.parametrize(
    ("result", "word"), [(1, "TEMPORARILY_REJECTED"), (2, "DENIED"), (3, "UNSUPPORTED"), (4, "FAILED")]
)
def test_a_refused_command_reports_its_result(
    commands: Commands, boat: ScriptedVehicle, result: int, word: str
) -> None:
    answering(boat, result)
    with pytest.raises(CommandDenied, match=word) as caught:
        commands.command_long(mavlink.MAV_CMD_DO_SET_MODE)
    assert (caught.value.command, caught.value.result) == (mavlink.MAV_CMD_DO_SET_MODE, result)


def test_a_command_in_progress_is_awaited(commands: Commands, boat: ScriptedVehicle, session: Session) -> None:
    def answer(m: Any) -> None:
        boat.acknowledge(m, 5)
        session.every(4.0, lambda: boat.acknowledge(m, 0) if session.clock.now() > begun + 3 else None)

    begun = session.clock.now()
    boat.on["COMMAND_LONG"] = answer
    commands.command_long(STEER)
    assert session.clock.now() - begun == pytest.approx(4.0, abs=0.3)


def test_a_command_that_stays_in_progress_raises_no_reply(commands: Commands, boat: ScriptedVehicle) -> None:
    answering(boat, 5)
    with pytest.raises(NoReply, match="did not finish"):
        commands.command_long(STEER)


def test_acknowledgements_of_other_commands_or_to_other_stations_are_ignored(
    commands: Commands, boat: ScriptedVehicle
) -> None:
    boat.on["COMMAND_LONG"] = lambda m: [
        boat.send(mavlink.MAVLink_command_ack_message(STEER + 1, 0, 0, 0, 255, 0)),
        boat.send(mavlink.MAVLink_command_ack_message(STEER, 0, 0, 0, 42, 0)),
    ]
    with pytest.raises(NoReply):
        commands.command_long(STEER)


# --- modes --------------------------------------------------------------------------------


def test_a_mode_is_confirmed_by_the_heartbeat(commands: Commands, boat: ScriptedVehicle) -> None:
    commands.set_mode("GUIDED")
    assert boat.mode == 15
    assert commands.mode == "GUIDED"


def test_a_refused_mode_is_reported_with_the_vehicles_message(commands: Commands, boat: ScriptedVehicle) -> None:
    boat.refused_modes[15] = "Mode change to GUIDED failed: requires position"
    with pytest.raises(ModeRefused, match=r"requires position.*stays in MANUAL"):
        commands.set_mode("GUIDED")


def test_a_mode_accepted_but_not_entered_is_reported_as_refused(commands: Commands, boat: ScriptedVehicle) -> None:
    boat.on["COMMAND_LONG"] = lambda m: boat.acknowledge(m, 0)
    with pytest.raises(ModeRefused, match="is in MANUAL"):
        commands.set_mode("HOLD")


def test_a_mode_is_not_ordered_again_while_the_vehicle_is_silent(commands: Commands, boat: ScriptedVehicle) -> None:
    """Another station may have ordered one meanwhile; a copy that arrives when the link is back would undo that."""
    boat.on["COMMAND_LONG"] = lambda m: None
    boat.mute.add("HEARTBEAT")
    with pytest.raises((NoReply, LinkLost)):
        commands.set_mode("HOLD")
    orders = [m for m in boat.heard if m.get_type() == "COMMAND_LONG" and m.command == mavlink.MAV_CMD_DO_SET_MODE]
    assert len(orders) == 1


def test_an_unknown_mode_is_reported_with_the_nearest_names(commands: Commands) -> None:
    with pytest.raises(UnknownName, match="Did you mean GUIDED"):
        commands.set_mode("GUIDE")


# --- arming --------------------------------------------------------------------------------


def test_arming_and_disarming_are_confirmed_by_the_heartbeat(
    commands: Commands, boat: ScriptedVehicle, session: Session
) -> None:
    commands.arm()
    assert session.armed
    commands.disarm()
    assert not session.armed


def test_refused_arming_is_reported_with_its_reasons(commands: Commands, boat: ScriptedVehicle) -> None:
    boat.arming_refusals = ["Arm: Throttle (RC3) is not neutral", "PreArm: Battery below minimum"]
    with pytest.raises(ArmingRefused, match="Battery below minimum") as caught:
        commands.arm()
    assert caught.value.reasons == tuple(boat.arming_refusals)


def test_earlier_prearm_messages_are_reported_as_reasons(
    commands: Commands, boat: ScriptedVehicle, session: Session
) -> None:
    boat.say("PreArm: Compass not calibrated")
    session.pause(1.0)
    boat.on["COMMAND_LONG"] = lambda m: boat.acknowledge(m, 4)
    with pytest.raises(ArmingRefused, match="Compass not calibrated"):
        commands.arm()


def test_a_refusal_without_a_reason_is_reported_as_such(commands: Commands, boat: ScriptedVehicle) -> None:
    boat.on["COMMAND_LONG"] = lambda m: boat.acknowledge(m, 4)
    with pytest.raises(ArmingRefused, match="no reason reported"):
        commands.arm()


def test_arming_accepted_but_not_done_is_reported_as_refused(commands: Commands, boat: ScriptedVehicle) -> None:
    boat.on["COMMAND_LONG"] = lambda m: boat.acknowledge(m, 0)
    with pytest.raises(ArmingRefused):
        commands.arm()


def test_a_vehicle_that_stays_armed_is_reported(commands: Commands, boat: ScriptedVehicle) -> None:
    commands.arm()
    boat.on["COMMAND_LONG"] = lambda m: boat.acknowledge(m, 0)
    with pytest.raises(CommandDenied, match="still armed"):
        commands.disarm()


@pytest.mark.parametrize("seed", range(4))
def test_commands_get_through_a_lossy_link(boat: ScriptedVehicle, seed: int) -> None:
    session = Session(MemoryLink(boat, loss=0.15, seed=seed))
    session.discover()
    Commands(session, FIRMWARE["ardurover"]).set_mode("HOLD")
    assert boat.mode == 4
