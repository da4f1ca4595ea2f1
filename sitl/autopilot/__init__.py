"""The simulated autopilot: the functions of ArduRover and ArduSub that a tuner uses.

``autopilot`` is what both share; ``rover*`` and ``sub*`` are the two firmwares; ``pid``, ``shaping``, ``plane`` and
``scurve`` the blocks their loops are built of; ``mission`` the stored mission; ``parameters`` the store,
``*_parameters`` the tables.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from sitl.autopilot.autopilot import INFO, SLOW_RATE, WARNING, Autopilot
from sitl.autopilot.mission import MOST_ITEMS, Command, Mission, MissionItem
from sitl.autopilot.parameter_dialect import GENERATIONS, ParameterDialect
from sitl.autopilot.parameters import Definition, ParameterStore, ReadOnlyParameter
from sitl.autopilot.pid import Pid
from sitl.autopilot.rover import STEERING_CHANNEL, THROTTLE_CHANNEL, Rover
from sitl.autopilot.rover_navigation import GuidedTarget
from sitl.autopilot.rover_parameters import ROVER_PARAMETERS
from sitl.autopilot.sub import Sub
from sitl.autopilot.sub_parameters import SUB_PARAMETERS

__all__ = [
    "FIRMWARE",
    "GENERATIONS",
    "INFO",
    "MOST_ITEMS",
    "SLOW_RATE",
    "STEERING_CHANNEL",
    "THROTTLE_CHANNEL",
    "WARNING",
    "Autopilot",
    "Command",
    "GuidedTarget",
    "Mission",
    "MissionItem",
    "ParameterDialect",
    "ParameterStore",
    "Pid",
    "ReadOnlyParameter",
    "Rover",
    "Sub",
    "loop_rate",
]

FIRMWARE: Mapping[str, tuple[type[Autopilot], Sequence[Definition]]] = {
    "rover": (Rover, ROVER_PARAMETERS),
    "sub": (Sub, SUB_PARAMETERS),
}
"""Firmware name in a vehicle's data file -> (autopilot class, its parameter definitions)."""

_MOST_RATE = 1000
"""Highest loop rate [Hz], because time is reported in whole milliseconds."""


def loop_rate(parameters: ParameterStore) -> int:
    """Return SCHED_LOOP_RATE [Hz] as applied here: a multiple of :data:`SLOW_RATE`, at most 1000."""
    whole = int(parameters["SCHED_LOOP_RATE"]) // SLOW_RATE * SLOW_RATE
    return max(SLOW_RATE, min(_MOST_RATE, whole))
