"""Random faults of the link, the vehicle and the computer during whole tunes, by seed.

``fault`` defines the kinds of faults. ``link`` applies them to a transport. ``vehicle`` is a simulated vehicle in this
process whose state can be read directly. ``case`` draws whole tunes with faults. ``referee`` runs one and checks the
final state of the vehicle. ``python3 -m benchmarks.faulted_tunes`` runs many.
"""

from __future__ import annotations

from benchmarks.faults.case import Case, draw_case, draw_station_case
from benchmarks.faults.fault import KINDS, STATION_KINDS, Fault
from benchmarks.faults.link import FaultyLink, Killed
from benchmarks.faults.referee import Outcome, run_case
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
    "run_case",
]
