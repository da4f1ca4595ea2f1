"""Kinds of plants that a vehicle file may name as its ``plant``, and the functions that make them from the file."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from sitl.plants.planar import PlanarHull
from sitl.plants.plant import Plant, Water
from sitl.plants.rigid_body import AxisDynamics, Coupling, coupling_of

__all__ = ["PLANTS", "RUDDER", "TWIN_THRUSTER", "make_plant", "values_of"]

Tables = Mapping[str, Any]
"""Content of a vehicle file: heading -> name -> ``value`` with unit and source."""

RUDDER, TWIN_THRUSTER = "rudder", "twin-thruster"
"""Names of the two kinds of boat actuators in a vehicle file. All other names are frames of ROVs."""


def make_plant(tables: Tables) -> Plant:
    """Return a new plant of the kind that a vehicle file names, at its initial position and at rest.

    Raises
    ------
    ValueError
        There is no such kind.
    """
    kind = str(tables.get("plant", PLANAR_HULL))
    if kind not in PLANTS:
        raise ValueError(f"there is no plant '{kind}'. Use one of {', '.join(PLANTS)}")
    plant, start = PLANTS[kind](tables), values_of(tables["start"])
    plant.state.z, plant.state.psi = start["depth"], start["heading"]
    return plant


def planar_hull(tables: Tables) -> PlanarHull:
    """Return a hull with those of surge, sway, heave, pitch and yaw for which the file has tables."""
    floats = tables["actuators"] in (RUDDER, TWIN_THRUSTER)
    water = Water(bottom=values_of(tables["start"])["bottom"], floats=floats)
    by_propeller = tables["actuators"] == RUDDER
    yaw = AxisDynamics(1.0, 0.0, 0.0) if by_propeller else _axis(tables["yaw"])
    heave = AxisDynamics(1.0, 0.0, 0.0) if floats else _axis(tables["heave"])
    sways, pitches = "sway" in tables, "pitch" in tables
    return PlanarHull(
        _axis(tables["surge"]),
        heave,
        yaw,
        water,
        sway=_axis(tables["sway"]) if sways else None,
        coupling=_coupling(tables["coupling"]) if sways else None,
        pitch=_axis(tables["pitch"]) if pitches else None,
        righting=values_of(tables["pitch"])["righting"] if pitches else 0.0,
    )


PLANAR_HULL = "planar-hull"
PLANTS: dict[str, Callable[[Tables], Plant]] = {PLANAR_HULL: planar_hull}
"""Name in a vehicle file -> function that makes the plant from the file. A file without a name has the first plant."""


def values_of(table: Mapping[str, Mapping[str, Any]]) -> dict[str, Any]:
    """Return name -> value of one heading of a vehicle file, without units and sources."""
    return {name: entry["value"] for name, entry in table.items()}


def _axis(table: Mapping[str, Mapping[str, Any]]) -> AxisDynamics:
    values = values_of(table)
    return AxisDynamics(values["alpha"], values["beta"], values["beta2"])


def _coupling(table: Mapping[str, Mapping[str, Any]]) -> Coupling:
    derivatives = values_of(table)
    coriolis = bool(derivatives.pop("coriolis"))
    return coupling_of(derivatives, coriolis=coriolis)
