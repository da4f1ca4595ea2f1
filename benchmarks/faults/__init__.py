"""Everything that can go wrong between a ground station and a vehicle, on purpose and by seed.

``fault`` says what goes wrong and when, ``link`` makes it so on any transport (lock-stepped or real), ``vehicle`` is a
simulated vehicle in this process that can be asked directly, ``case`` draws whole tunes with faults, ``referee`` plays
one and judges it by what the vehicle holds afterwards. ``python3 -m benchmarks.faulted_tunes`` plays many.
"""

from __future__ import annotations

from benchmarks.faults.case import Case, draw_case, draw_station_case
from benchmarks.faults.fault import KINDS, STATION_KINDS, Fault
from benchmarks.faults.link import FaultyLink, Killed
from benchmarks.faults.referee import Outcome, play
from benchmarks.faults.vehicle import Condition, VehicleAsFound

__all__ = [
    "KINDS",
    "STATION_KINDS",
    "Case",
    "Condition",
    "Fault",
    "FaultyLink",
    "Killed",
    "Outcome",
    "VehicleAsFound",
    "draw_case",
    "draw_station_case",
    "play",
]
