"""One wrong PARAM_VALUE under the vehicle's own id: stale, doubled or forged."""

from __future__ import annotations

from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from scripted_vehicle import ScriptedVehicle

from gcs_autotune.errors import NoReply, ParameterNotAccepted, TelemetryFault
from gcs_autotune.link import Journal, Parameters, ParameterTransaction

P = "ATC_STR_RAT_P"


def lie(boat: ScriptedVehicle, value: float) -> None:
    boat.send(mavlink.MAVLink_param_value_message(P.encode(), value, 9, len(boat.parameters), 65535))


class Liar:
    """Answers each request for P with a wrong value before or after the true one."""

    def __init__(self, boat: ScriptedVehicle, lies: list[float], *, after: bool = False) -> None:
        self.boat, self.lies, self.after = boat, lies, after
        boat.on["PARAM_REQUEST_READ"] = self

    def __call__(self, message: Any) -> None:
        reported = self.lies.pop(0) if self.lies and message.param_id == P else None
        if reported is not None and not self.after:
            lie(self.boat, reported)
        self.boat._on_param_request_read(message)
        if reported is not None and self.after:
            lie(self.boat, reported)


@pytest.mark.parametrize("after", [False, True])
@pytest.mark.parametrize("lies", [[7.0], [7.0, 8.0], [7.0, 8.0, 9.0, 10.0]])
def test_scattered_wrong_answers_are_outvoted(
    parameters: Parameters, boat: ScriptedVehicle, lies: list[float], after: bool
) -> None:
    Liar(boat, lies, after=after)
    assert parameters.read_confirmed([P])[P] == pytest.approx(0.2)


def test_as_many_wrong_as_right_answers_stop_the_loan_before_any_write(
    parameters: Parameters, boat: ScriptedVehicle, tmp_path: Any
) -> None:
    Liar(boat, [7.0] * 99, after=True)
    journal = Journal(tmp_path / "journal.jsonl")
    with pytest.raises(TelemetryFault, match=r"contradicting values of .* \(0.2, 7\)"):
        ParameterTransaction(parameters, journal).set({P: 0.5})
    journal.leave()
    assert boat.count("PARAM_SET") == 0


def test_a_late_answer_with_the_old_value_is_not_taken_for_the_echo(
    parameters: Parameters, boat: ScriptedVehicle
) -> None:
    sets: list[Any] = []

    def first_is_lost(message: Any) -> None:
        sets.append(message)
        if len(sets) == 1:
            lie(boat, message.param_value)  # what somebody asked for long ago, when it was still so
        else:
            boat._on_param_set(message)

    boat.on["PARAM_SET"] = first_is_lost
    parameters.write(P, 0.5)
    assert boat.parameters[P] == pytest.approx(0.5)
    assert len(sets) == 2


def test_a_delayed_write_is_corrected_while_restoring(
    parameters: Parameters, boat: ScriptedVehicle, tmp_path: Any
) -> None:
    journal = Journal(tmp_path / "journal.jsonl")
    transaction = ParameterTransaction(parameters, journal)
    transaction.set({P: 0.5})
    answers, writes = [0], boat.count("PARAM_SET")

    def overtaken(message: Any) -> None:
        answers[0] += 1
        if answers[0] == 3:  # after the two that confirm the old value
            boat.parameters[P] = 0.5
        boat._on_param_request_read(message)

    boat.on["PARAM_REQUEST_READ"] = overtaken
    transaction.give_back()
    journal.leave()
    assert boat.parameters[P] == pytest.approx(0.2)
    assert boat.count("PARAM_SET") == writes + 2


def test_a_value_that_the_vehicle_no_longer_holds_is_not_kept(
    parameters: Parameters, boat: ScriptedVehicle, tmp_path: Any
) -> None:
    journal = Journal(tmp_path / "journal.jsonl")
    with (
        pytest.raises(ParameterNotAccepted, match="another station changed it"),
        ParameterTransaction(parameters, journal) as transaction,
    ):
        transaction.set({P: 0.5})
        boat.parameters[P] = 0.9
        transaction.keep()
    journal.leave()
    assert boat.parameters[P] == pytest.approx(0.9), "what another station wrote stands"
    assert Journal.open_debts(journal.path) == {}


def test_a_vehicle_that_stops_answering_is_not_taken_for_one_without_the_parameter(
    parameters: Parameters, boat: ScriptedVehicle
) -> None:
    parameters.read("WP_SPEED")
    boat.mute.add("PARAM_VALUE")
    with pytest.raises(NoReply, match="no longer answers"):
        parameters.read(P)


def test_restoring_waits_for_a_vehicle_behind_a_pier(
    parameters: Parameters, boat: ScriptedVehicle, tmp_path: Any
) -> None:
    journal = Journal(tmp_path / "journal.jsonl")
    transaction = ParameterTransaction(parameters, journal)
    transaction.set({P: 0.5})
    step, gone = boat._step, boat.time
    boat.alive = False

    def back_after_twenty_seconds(t: float) -> bytes:
        boat.alive = boat.alive or boat.time > gone + 20.0
        return ScriptedVehicle.advance_to(boat, t)

    boat.advance_to = back_after_twenty_seconds  # type: ignore[method-assign]
    transaction.give_back()
    journal.leave()
    assert step is not None and boat.parameters[P] == pytest.approx(0.2)
