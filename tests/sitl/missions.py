"""Missions for the tests: items, their upload, and the result."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sitl.place import to_globe
from tests.sitl.ground import Ground, boat

AUTO, LOITER, RTL = 10, 5, 11
WAYPOINT, LOITER_UNLIMITED, LOITER_TIME, RETURN, CHANGE_SPEED = 16, 17, 19, 20, 178
RELATIVE = 6

Step = tuple[int, complex | None, Sequence[float]]
"""MAV_CMD, place [m] or None, four parameters."""


def waypoint(place: complex, wait: float = 0.0) -> Step:
    return WAYPOINT, place, (wait, 0.0, 0.0, 0.0)


def step(command: int, place: complex | None = None, parameters: Sequence[float] = (0.0, 0.0, 0.0, 0.0)) -> Step:
    return command, place, parameters


def item(seq: int, what: Step, frame: int = RELATIVE) -> Any:
    command, place, parameters = what
    x, y = (0, 0) if place is None else to_globe(place)
    return mavlink.MAVLink_mission_item_int_message(1, 1, seq, frame, command, 0, 1, *parameters, x, y, 0.0, 0)


def upload(ground: Ground, steps: Sequence[Step]) -> int:
    """Upload home and *steps*; return MAV_MISSION_RESULT."""
    items = [item(seq, what) for seq, what in enumerate([waypoint(0j), *steps])]
    return send(ground, items)


def send(ground: Ground, items: Sequence[Any], *, wait: float = 0.5) -> int:
    """Upload *items* on request; return MAV_MISSION_RESULT, or -1 if none was received."""
    ground.send(mavlink.MAVLink_mission_count_message(1, 1, len(items), 0))
    for _ in range(len(items) + 5):
        for message in ground.run(wait):
            if message.get_type() == "MISSION_ACK":
                return int(message.type)
            if message.get_type() == "MISSION_REQUEST" and message.seq < len(items):
                ground.send(items[message.seq])
    return -1


def sailing(steps: Sequence[Step], **options: Any) -> Ground:
    """Return a tuned charlie in AUTO on a mission of *steps*."""
    parameters = {"ATC_STR_RAT_FF": 3.0, "ATC_STR_RAT_P": 2.0, "ATC_STR_ANG_P": 1.0, **options.pop("parameters", {})}
    ground = boat(parameters=parameters, **options)
    assert upload(ground, steps) == 0
    assert ground.mode(AUTO) == 0
    return ground


def twin(**parameters: float) -> Ground:
    """Return a ground station with the blueboat, armed in MANUAL."""
    ground = Ground("blueboat", parameters=parameters)
    ground.sticks = {1: 1500, 3: 1500}
    ground.run(5.0)
    assert ground.command(400, 1) == 0
    return ground


def run_until_reached(ground: Ground, seq: int, within: float = 300.0) -> float:
    """Let time pass until item *seq* is reported as reached; return when [s]."""
    end = ground.t + within
    while ground.t < end:
        if any(m.get_type() == "MISSION_ITEM_REACHED" and m.seq == seq for m in ground.run(0.2)):
            return ground.t
    raise AssertionError(f"item {seq} was not reached within {within} s; {ground.texts()[-3:]}")


def place(ground: Ground) -> complex:
    return complex(ground.vehicle.state.x, ground.vehicle.state.y)


def speed(ground: Ground) -> float:
    """Return the true speed over ground [m/s]."""
    state, water = ground.vehicle.state, ground.vehicle.plant.water
    c, s = math.cos(state.psi), math.sin(state.psi)
    return math.hypot(state.u * c - state.v * s + water.V_x, state.u * s + state.v * c + water.V_y)
