from __future__ import annotations

import math
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from scripted_vehicle import ScriptedVehicle

from gcs_autotune.errors import LinkLost, ParameterMissing, ParameterNotAccepted, UsageError
from gcs_autotune.link import MemoryLink, Parameters, Session


def connect(boat: ScriptedVehicle, **link: Any) -> Parameters:
    session = Session(MemoryLink(boat, **link))
    session.discover()
    return Parameters(session)


# --- reading --------------------------------------------------------------------------------


def test_a_parameter_is_read_by_name(parameters: Parameters, boat: ScriptedVehicle) -> None:
    assert parameters.read("ATC_STR_RAT_P") == pytest.approx(0.2)
    assert boat.last("PARAM_REQUEST_READ").param_index == -1


def test_an_unknown_name_is_missing_after_three_requests_of_a_second(
    parameters: Parameters, boat: ScriptedVehicle
) -> None:
    begun = parameters.session.clock.now()
    with pytest.raises(ParameterMissing, match="NO_SUCH_THING") as caught:
        parameters.read("NO_SUCH_THING")
    assert caught.value.name == "NO_SUCH_THING"
    assert boat.count("PARAM_REQUEST_READ") == 3
    assert parameters.session.clock.now() - begun == pytest.approx(3.0, abs=0.05)


def test_param_error_of_newer_firmware_ends_the_wait(parameters: Parameters, boat: ScriptedVehicle) -> None:
    boat.on["PARAM_REQUEST_READ"] = lambda m: boat.send(
        mavlink.MAVLink_param_error_message(255, 190, m.param_id.encode(), -1, 1)
    )
    begun = parameters.session.clock.now()
    with pytest.raises(ParameterMissing):
        parameters.read("NO_SUCH_THING")
    assert parameters.session.clock.now() - begun < 0.5
    assert boat.count("PARAM_REQUEST_READ") == 1
    del boat.on["PARAM_REQUEST_READ"]
    boat.parameters["NO_SUCH_THING"] = 2.0
    assert parameters.read("NO_SUCH_THING") == 2.0, "a refusal is of its own question only"


def test_alternative_names_whose_answers_were_lost_are_requested_again(
    parameters: Parameters, boat: ScriptedVehicle
) -> None:
    lost = {"ATC_STR_RAT_P": 2}
    answer = boat._on_param_request_read

    def sometimes(m: Any) -> None:
        if lost.get(m.param_id, 0) > 0:
            lost[m.param_id] -= 1
        else:
            answer(m)

    boat.on["PARAM_REQUEST_READ"] = sometimes
    found = parameters.read_any([("ATC_STR_RAT_P",), ("NO_SUCH_THING", "CRUISE_THROTTLE")])
    assert set(found) == {"ATC_STR_RAT_P", "CRUISE_THROTTLE"}


def test_no_more_requests_are_outstanding_than_a_slow_radio_holds(
    parameters: Parameters, boat: ScriptedVehicle
) -> None:
    names = [f"NO_SUCH_{k}" for k in range(31)]
    with pytest.raises(ParameterMissing):
        parameters.read_all(names)
    boat.on["PARAM_REQUEST_READ"] = lambda m: None
    before, begun = boat.count("PARAM_REQUEST_READ"), parameters.session.clock.now()
    with pytest.raises(ParameterMissing):
        parameters.read_all(names)
    requested, took = boat.count("PARAM_REQUEST_READ") - before, parameters.session.clock.now() - begun
    assert (requested, took) == (
        93,
        pytest.approx(12.0, abs=0.2),
    )  # three tries of groups of ten, ten, ten and one, a second each


@pytest.mark.parametrize("seed", range(5))
def test_lost_frames_are_requested_again(boat: ScriptedVehicle, seed: int) -> None:
    parameters = connect(boat, loss=0.1, seed=seed)
    assert len(parameters.read_existing(f"RC{n}_MIN" for n in range(1, 5))) == 4
    assert parameters.read_full() == pytest.approx(boat.parameters)


def test_a_forged_value_from_another_system_is_ignored(parameters: Parameters, boat: ScriptedVehicle) -> None:
    boat.mute.add("PARAM_VALUE")
    forged = mavlink.MAVLink_param_value_message(b"WP_SPEED", 99.0, 9, 10, 1)
    boat.on["PARAM_REQUEST_READ"] = lambda _: boat.send_as(2, 1, forged)
    with pytest.raises(ParameterMissing):
        parameters.read("WP_SPEED")
    boat.on["PARAM_REQUEST_READ"] = lambda _: boat.send_as(1, 25, forged)
    with pytest.raises(ParameterMissing):
        parameters.read("WP_SPEED")


def test_a_vehicle_that_falls_silent_while_waiting_is_a_lost_link(
    parameters: Parameters, boat: ScriptedVehicle
) -> None:
    boat.alive = False
    with pytest.raises(LinkLost):
        for _ in range(3):
            parameters.read_existing(["WP_SPEED"])


@pytest.mark.parametrize("name", ["", "A_NAME_OF_17_CHARS", "GRÖSSE"])
def test_an_impossible_name_is_a_usage_error(parameters: Parameters, name: str) -> None:
    with pytest.raises(UsageError, match="is not a parameter name"):
        parameters.read(name)


def test_a_name_of_sixteen_letters_works(parameters: Parameters, boat: ScriptedVehicle) -> None:
    boat.parameters["SIXTEEN_LETTERS_"] = 4.0
    assert parameters.read("SIXTEEN_LETTERS_") == 4.0


# --- writing --------------------------------------------------------------------------------


def test_a_write_is_verified_by_its_echo_and_by_reading_it_back_twice(
    parameters: Parameters, boat: ScriptedVehicle
) -> None:
    begun = parameters.session.clock.now()
    parameters.write("ATC_STR_RAT_P", 0.33)
    assert parameters.session.clock.now() - begun < 0.5, "an echo that came is not waited for"
    assert boat.parameters["ATC_STR_RAT_P"] == pytest.approx(0.33)
    assert boat.count("PARAM_SET") == 1
    assert boat.count("PARAM_REQUEST_READ") == 2
    assert boat.last("PARAM_SET").param_type == mavlink.MAV_PARAM_TYPE_REAL32


def test_whole_numbers_are_sent_as_floats_and_never_bytewise(parameters: Parameters, boat: ScriptedVehicle) -> None:
    parameters.write("CRUISE_THROTTLE", 45)
    assert boat.last("PARAM_SET").param_value == 45.0


def test_a_read_only_parameter_is_not_accepted_and_the_reason_is_reported(
    parameters: Parameters, boat: ScriptedVehicle
) -> None:
    boat.read_only.add("WP_SPEED")
    with pytest.raises(ParameterNotAccepted, match="write denied") as caught:
        parameters.write("WP_SPEED", 9.0)
    assert (caught.value.name, caught.value.wanted, caught.value.found) == ("WP_SPEED", 9.0, 2.0)


def test_a_value_rounded_by_the_vehicle_is_not_accepted(parameters: Parameters) -> None:
    with pytest.raises(ParameterNotAccepted) as caught:
        parameters.write("CRUISE_THROTTLE", 33.4)
    assert caught.value.found == 33.0


def test_writing_an_unknown_name_raises_parameter_missing(parameters: Parameters) -> None:
    with pytest.raises(ParameterMissing):
        parameters.write("NO_SUCH_THING", 1.0)


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, 3.5e38, -1e300])
def test_values_outside_finite_float32_are_never_sent(
    parameters: Parameters, boat: ScriptedVehicle, value: float
) -> None:
    with pytest.raises(UsageError, match="finite"):
        parameters.write("WP_SPEED", value)
    assert boat.count("PARAM_SET") == 0


@pytest.mark.parametrize("seed", range(5))
def test_writes_get_through_a_lossy_link(boat: ScriptedVehicle, seed: int) -> None:
    connect(boat, loss=0.2, seed=seed).write("ATC_STR_RAT_I", 0.4)
    assert boat.parameters["ATC_STR_RAT_I"] == pytest.approx(0.4)


# --- watching --------------------------------------------------------------------------------


def test_a_foreign_write_is_detected(parameters: Parameters, boat: ScriptedVehicle) -> None:
    parameters.watch({"ATC_STR_RAT_P": parameters.read("ATC_STR_RAT_P")})
    boat.parameters["ATC_STR_RAT_P"] = 1.5
    boat.send_parameter("ATC_STR_RAT_P")
    parameters.session.pause(1.0)
    assert parameters.intrusions == [("ATC_STR_RAT_P", pytest.approx(0.2), 1.5)]


def test_our_own_writes_are_not_intrusions(parameters: Parameters, boat: ScriptedVehicle) -> None:
    parameters.watch({"ATC_STR_RAT_P": parameters.read("ATC_STR_RAT_P")})
    parameters.write("ATC_STR_RAT_P", 0.4)
    boat.send_parameter("ATC_STR_RAT_P")
    parameters.session.pause(1.0)
    assert parameters.intrusions == []


def test_a_write_without_an_echo_or_effect_is_given_up_after_three_attempts(
    parameters: Parameters, boat: ScriptedVehicle
) -> None:
    boat.on["PARAM_SET"] = lambda message: None
    with pytest.raises(ParameterNotAccepted, match=r"ATC_STR_RAT_P: wrote 0\.7, but the vehicle reports 0\.2"):
        parameters.write("ATC_STR_RAT_P", 0.7)
    assert boat.count("PARAM_SET") == 3


def test_a_write_that_was_echoed_and_undone_at_once_is_written_again(
    parameters: Parameters, boat: ScriptedVehicle
) -> None:
    undone: list[int] = []

    def twin(message: object) -> None:
        boat._on_param_set(message)
        if not undone:  # another hand, once
            undone.append(1)
            boat.parameters["ATC_STR_RAT_P"] = 0.2

    boat.on["PARAM_SET"] = twin
    parameters.write("ATC_STR_RAT_P", 0.7)
    assert boat.parameters["ATC_STR_RAT_P"] == pytest.approx(0.7)
    assert boat.count("PARAM_SET") == 2


def test_a_complete_list_is_requested_once_and_only_its_gaps_are_requested_again(
    parameters: Parameters, boat: ScriptedVehicle
) -> None:
    assert parameters.read_full() == pytest.approx(boat.parameters)
    assert (boat.count("PARAM_REQUEST_LIST"), boat.count("PARAM_REQUEST_READ")) == (1, 0)
    lost = {3, 7, 20}

    def lose(message: object) -> object:
        index = getattr(message, "param_index", -1)
        if index in lost:
            lost.discard(index)
            return None
        return message

    boat.edit = lose  # type: ignore[assignment]
    assert len(parameters.read_full()) == len(boat.parameters)
    assert boat.count("PARAM_REQUEST_LIST") == 2
    requested = [m for m in boat.heard if m.get_type() == "PARAM_REQUEST_READ"]
    assert sorted((m.param_index, m.param_id) for m in requested) == [(3, ""), (7, ""), (20, "")]


def test_gaps_are_not_requested_while_the_list_still_arrives(parameters: Parameters, boat: ScriptedVehicle) -> None:
    waiting: list[str] = []
    boat.on["PARAM_REQUEST_LIST"] = lambda _: waiting.extend(boat.parameters)
    known, names = boat._step, list(boat.parameters)

    def step() -> None:
        known()
        for name in waiting[:5]:
            boat.send_parameter(name, names.index(name))
        del waiting[:5]

    boat._step = step  # type: ignore[method-assign]
    assert len(parameters.read_full()) == len(names)
    assert boat.count("PARAM_REQUEST_READ") == 0
