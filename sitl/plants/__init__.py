"""Bodies in water: the protocol used by the rest of the simulator, and the bodies that implement it."""

from sitl.plants.planar import PlanarHull
from sitl.plants.plant import GRAVITY, Parameters, Plant, State, Water, Wrench, measured_speed
from sitl.plants.propulsion import propeller_rows, static_thrust, thruster_count
from sitl.plants.rigid_body import (
    DOFS,
    AxisDynamics,
    Ballast,
    Coupling,
    RigidBody,
    angles_of,
    coupling_of,
    quaternion_of,
    rotate,
)
from sitl.plants.table import PLANTS, RUDDER, TWIN_THRUSTER, Entries, make_plant, values_of

__all__ = [
    "DOFS",
    "GRAVITY",
    "PLANTS",
    "RUDDER",
    "TWIN_THRUSTER",
    "AxisDynamics",
    "Ballast",
    "Coupling",
    "Entries",
    "Parameters",
    "PlanarHull",
    "Plant",
    "RigidBody",
    "State",
    "Water",
    "Wrench",
    "angles_of",
    "coupling_of",
    "make_plant",
    "measured_speed",
    "propeller_rows",
    "quaternion_of",
    "rotate",
    "static_thrust",
    "thruster_count",
    "values_of",
]
