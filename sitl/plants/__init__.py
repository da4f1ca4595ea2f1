"""Bodies in water: the protocol used by the rest of the simulator, and the bodies that implement it."""

from sitl.plants.planar import AxisDynamics, Coupling, PlanarHull, PlanarTerm, coupling_of
from sitl.plants.plant import GRAVITY, Parameters, Plant, State, Water, Wrench, measured_speed

__all__ = [
    "GRAVITY",
    "AxisDynamics",
    "Coupling",
    "Parameters",
    "PlanarHull",
    "PlanarTerm",
    "Plant",
    "State",
    "Water",
    "Wrench",
    "coupling_of",
    "measured_speed",
]
