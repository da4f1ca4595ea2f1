"""Kinds of plants that a vehicle file may name as its ``plant``, and the functions that make them from the file."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from sitl.plants.kernel import MOST_PROPELLERS
from sitl.plants.planar import PlanarHull
from sitl.plants.plant import Plant, Water
from sitl.plants.propulsion import propeller_rows, rudder_rows
from sitl.plants.rigid_body import DOFS, Array, AxisDynamics, Ballast, Coupling, RigidBody, coupling_of

__all__ = ["PLANTS", "RUDDER", "TWIN_THRUSTER", "Entries", "make_plant", "values_of"]

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
        raise ValueError(f"plant: there is no '{kind}'. Use one of {', '.join(PLANTS)}")
    plant, start = PLANTS[kind](tables), values_of(tables["start"])
    plant.state.z, plant.state.psi = start["depth"], start["heading"]
    return plant


def planar_hull(tables: Tables) -> PlanarHull:
    """Return a hull with those of surge, sway, heave, pitch and yaw for which the file has tables."""
    water = _water(tables)
    floats = water.floats
    by_propeller = tables["actuators"] == RUDDER and "rudder" not in tables
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
        **_propulsion(tables),
    )


def rigid_body(tables: Tables) -> RigidBody:
    """Return a body with those of the six degrees of freedom for which the file has tables.

    Raises
    ------
    ValueError
        Its inertia is not symmetric and positive.
    """
    axes = {dof: _axis(tables[dof]) for dof in DOFS if dof in tables}
    at = values_of(tables["body"])
    centre, lift = (tuple(at.get(f"{axis}_{point}", 0.0) for axis in "xyz") for point in "GB")
    ballast = Ballast(
        at["mass"],
        (centre[0], centre[1], centre[2]),
        (at.get("I_xy", 0.0), at.get("I_xz", 0.0), at.get("I_yz", 0.0)),
        at.get("weight", 0.0),
        at.get("buoyancy", 0.0),
        (lift[0], lift[1], lift[2]),
        at.get("waterplane", 0.0),
        (at.get("righting_roll", 0.0), at.get("righting_pitch", 0.0)),
    )
    speeds = "".join("uvwpqr"[DOFS.index(dof)] for dof in axes)
    coupling = _coupling(tables["coupling"], speeds)
    made = RigidBody(axes, _water(tables), coupling=coupling, ballast=ballast, **_propulsion(tables))
    held = [DOFS.index(dof) for dof in axes]
    inertia = made.body[:6][np.ix_(held, held)]
    if not np.allclose(inertia, inertia.T, rtol=1e-9):
        raise ValueError("coupling: the inertia is not symmetric. Give a derivative and its mirror the same value")
    least = float(np.linalg.eigvalsh(inertia).min())
    if least <= 0.0:
        raise ValueError(
            f"body: the inertia has the eigenvalue {least:.3g}, but a body needs all above 0. Check mass, centre and "
            "products of inertia against alpha"
        )
    return made


PLANAR_HULL = "planar-hull"
PLANTS: dict[str, Callable[[Tables], Plant]] = {PLANAR_HULL: planar_hull, "rigid-body": rigid_body}
"""Name in a vehicle file -> function that makes the plant from the file. A file without a name has the first plant."""


class Entries(dict[str, Any]):
    """Entries of a vehicle file under *heading*, or its headings. The ``KeyError`` of an entry that is missing names
    its heading too: ``surge.alpha``.
    """

    def __init__(self, entries: Mapping[str, Any], heading: str = "") -> None:
        super().__init__(entries)
        self.heading = heading

    def __missing__(self, name: str) -> Any:
        raise KeyError(f"{self.heading}.{name}" if self.heading else name)


def values_of(table: Mapping[str, Mapping[str, Any]]) -> dict[str, Any]:
    """Return name -> value of one heading of a vehicle file, without units and sources."""
    heading = table.heading if isinstance(table, Entries) else ""
    return Entries({name: entry["value"] for name, entry in table.items()}, heading)


def _axis(table: Mapping[str, Mapping[str, Any]]) -> AxisDynamics:
    values = values_of(table)
    return AxisDynamics(values["alpha"], values["beta"], values["beta2"])


def _coupling(table: Mapping[str, Mapping[str, Any]], speeds: str = "uvr") -> Coupling:
    derivatives = values_of(table)
    coriolis = bool(derivatives["coriolis"])
    del derivatives["coriolis"]
    try:
        return coupling_of(derivatives, coriolis=coriolis, speeds=speeds)
    except ValueError as error:
        raise ValueError(f"coupling: {error}") from error


def _water(tables: Tables) -> Water:
    floats = tables["actuators"] in (RUDDER, TWIN_THRUSTER)
    return Water(bottom=values_of(tables["start"])["bottom"], floats=floats)


def _propulsion(tables: Tables) -> dict[str, Array]:
    """Return the propellers and rudders of the file, as arguments of a body."""
    if "thrusters" not in tables:
        return {}
    parts = (values_of(tables.get(heading, {})) for heading in ("thrusters", "propeller", "motor"))
    if "diameter" not in tables.get("propeller", {}) and not {"a_ahead", "b_ahead"} & set(tables["thrusters"]):
        raise ValueError("thrusters: missing entry 'a_ahead'. Give it, b_ahead, or a [propeller] with its diameter")
    propellers = propeller_rows(*parts)
    if len(propellers) > MOST_PROPELLERS:
        raise ValueError(f"thrusters: {len(propellers)} are too many. Use at most {MOST_PROPELLERS}")
    if "rudder" not in tables:
        return {"propellers": propellers}
    return {"propellers": propellers, "rudders": rudder_rows(values_of(tables["rudder"]), len(propellers))}
