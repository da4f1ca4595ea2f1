"""The stand-in autopilot: ArduRover and ArduSub as far as a tuner meets them.

``autopilot`` is what both share; ``rover*`` and ``sub*`` are the two firmwares; ``pid`` and ``shaping`` the blocks
their loops are built of; ``parameters`` the store, ``*_parameters`` the tables.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from sitl.autopilot.autopilot import Autopilot
from sitl.autopilot.parameters import Definition
from sitl.autopilot.rover import Rover
from sitl.autopilot.rover_parameters import ROVER_PARAMETERS
from sitl.autopilot.sub import Sub
from sitl.autopilot.sub_parameters import SUB_PARAMETERS

__all__ = ["FIRMWARE", "Autopilot"]

FIRMWARE: Mapping[str, tuple[type[Autopilot], Sequence[Definition]]] = {
    "rover": (Rover, ROVER_PARAMETERS),
    "sub": (Sub, SUB_PARAMETERS),
}
"""Name in a vehicle's data file -> the autopilot and its parameters."""
