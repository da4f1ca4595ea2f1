"""Our boat accepts, refuses and reports missions as ArduPilot's does."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

ACCEPTED = mavlink.MAV_MISSION_ACCEPTED
RELATIVE = mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT
FREE = (0.0, 0.0, 0.0, math.nan)


def item(seq: int, command: int, parameters: Sequence[float] = (0.0,) * 4, frame: int = RELATIVE, **place: int) -> Any:
    x, y = place.get("x", 444_252_000), place.get("y", 87_641_000)
    return mavlink.MAVLink_mission_item_int_message(1, 1, seq, frame, command, 0, 1, *parameters, x, y, 0.0, 0)


def upload(station: Any, items: Sequence[Any]) -> int:
    """Upload *items* as they are requested and return MAV_MISSION_RESULT."""
    results: list[int] = []

    def answer(message: Any) -> None:
        if message.seq < len(items):
            station.session.send(items[message.seq])

    stops = [
        station.session.listen("MISSION_REQUEST", answer),
        station.session.listen("MISSION_ACK", lambda m: results.append(m.type)),
    ]
    try:
        station.session.send(mavlink.MAVLink_mission_count_message(1, 1, len(items), 0))
        station.wait(lambda: bool(results), 10.0)
    finally:
        for stop in stops:
            stop()
    return results[0]


def request(station: Any, question: Any, kind: str) -> Any:
    """Send *question* and return the first message of *kind* that comes."""
    got: list[Any] = []
    stop = station.session.listen(kind, got.append)
    try:
        station.session.send(question)
        station.wait(lambda: bool(got), 5.0)
    finally:
        stop()
    return got[0]


HOME, POINT = item(0, 16), item(1, 16)
CASES = {
    "a waypoint": (item(1, 16), ACCEPTED),
    "a waypoint without a heading": (item(1, 16, FREE), ACCEPTED),
    "loitering without limit": (item(1, 17, FREE), ACCEPTED),
    "loitering for a time": (item(1, 19, (5.0, 0, 0, 0)), ACCEPTED),
    "a return": (item(1, 20), ACCEPTED),
    "a speed": (item(1, 178, (1.0, 0.6, -1.0, 0.0)), ACCEPTED),
    "an unknown command": (item(1, 31000), mavlink.MAV_MISSION_UNSUPPORTED),
    "a reserved command": (item(1, 1), mavlink.MAV_MISSION_INVALID),
    "a frame that is none": (item(1, 16, frame=77), mavlink.MAV_MISSION_UNSUPPORTED_FRAME),
    "an endless wait": (item(1, 16, (math.inf, 0, 0, 0)), mavlink.MAV_MISSION_INVALID_PARAM1),
    "no speed": (item(1, 178, (1.0, math.nan, 0, 0)), mavlink.MAV_MISSION_INVALID_PARAM2),
    "no heading for a time": (item(1, 19, FREE), mavlink.MAV_MISSION_INVALID_PARAM4),
    "beyond the pole": (item(1, 16, x=910_000_000), mavlink.MAV_MISSION_INVALID_PARAM5_X),
    "beyond the date line": (item(1, 16, y=1_810_000_000), mavlink.MAV_MISSION_INVALID_PARAM6_Y),
}


def test_our_boat_and_ardupilot_accept_and_refuse_the_same_items(boat):
    assert {name: upload(boat, [HOME, message]) for name, (message, _) in CASES.items()} == {
        name: result for name, (_, result) in CASES.items()
    }


def test_a_mission_is_returned_with_home_as_item_0(boat):
    assert upload(boat, [HOME, POINT, item(2, 178, (1.0, 0.6, -1.0, 0.0))]) == ACCEPTED
    count = request(boat, mavlink.MAVLink_mission_request_list_message(1, 1, 0), "MISSION_COUNT")
    assert count.count == 3
    got = [request(boat, mavlink.MAVLink_mission_request_int_message(1, 1, k, 0), "MISSION_ITEM_INT") for k in range(3)]
    assert [m.command for m in got] == [16, 16, 178]
    assert [m.frame for m in got] == [0, mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT, 0]
    assert (got[1].x, got[1].y) == (POINT.x, POINT.y)
    assert got[2].param2 == pytest.approx(0.6)


def test_requesting_a_missing_item_returns_the_count_and_an_error(boat):
    upload(boat, [HOME, POINT])
    question = mavlink.MAVLink_mission_request_int_message(1, 1, 9, 0)
    assert request(boat, question, "MISSION_COUNT").count == 2
    assert request(boat, question, "MISSION_ACK").type == mavlink.MAV_MISSION_ERROR


def test_too_many_items_are_refused(boat):
    ack = request(boat, mavlink.MAVLink_mission_count_message(1, 1, 60000, 0), "MISSION_ACK")
    assert ack.type == mavlink.MAV_MISSION_NO_SPACE


def test_a_stalled_upload_is_cancelled_after_eight_seconds(boat):
    begun = boat.t
    request(boat, mavlink.MAVLink_mission_count_message(1, 1, 2, 0), "MISSION_REQUEST")
    acks: list[int] = []
    boat.session.listen("MISSION_ACK", lambda m: acks.append(m.type))
    boat.wait(lambda: bool(acks), 15.0)
    assert acks == [mavlink.MAV_MISSION_OPERATION_CANCELLED]
    assert boat.t - begun == pytest.approx(8.0, abs=1.0)


def test_a_cleared_mission_is_empty_and_auto_is_refused(boat):
    ack = request(boat, mavlink.MAVLink_mission_clear_all_message(1, 1, 0), "MISSION_ACK")
    assert ack.type == ACCEPTED
    result = boat.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 10)
    assert result == mavlink.MAV_RESULT_FAILED
    boat.wait(lambda: any("No Mission. Can't set AUTO." in text for _, text in boat.texts), 3.0)


def test_an_unfinished_mission_is_shown_as_not_started(boat):
    upload(boat, [HOME, POINT])
    boat.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, mavlink.MAVLINK_MSG_ID_MISSION_CURRENT, 200000.0)
    got: list[Any] = []
    boat.session.listen("MISSION_CURRENT", got.append)
    boat.wait(lambda: bool(got), 3.0)
    assert got[0].mission_state == mavlink.MISSION_STATE_NOT_STARTED
    assert got[0].total in (0, 1)
