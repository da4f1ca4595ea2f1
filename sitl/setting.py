"""What hidden effects know of the craft that they act on, at power-up."""

from __future__ import annotations

import math

from sitl.actuators import Actuators
from sitl.effects import Setting
from sitl.plants import Plant

__all__ = ["setting_of"]

_CHANNELS = {"yaw": "N", "surge": "X", "heave": "Z", "sway": "Y"}
_NAMES = {
    "N": ("steering", "rudder", "yaw", "delta"),
    "X": ("throttle", "surge"),
    "Z": ("vertical", "heave"),
    "Y": ("lateral", "sway"),
}


def setting_of(plant: Plant, actuators: Actuators, *, is_boat: bool, mass: float, seed: str) -> Setting:
    """Return the data of a craft that effects may use. mass : [kg], 0 if unknown. seed : of their random numbers."""
    full = actuators.full
    sways = "sway" in plant.dofs
    inputs = {_CHANNELS[dof]: dof for dof in full}
    signals = ("psi", "r", "phi", "theta", "p", "q", "u", *["v"][:sways], "x", "y")
    return Setting(
        state=plant.state,
        water=plant.water,
        parameters=plant.parameters,
        dofs=tuple(dict.fromkeys((*full, *["sway"][:sways]))),
        inputs=inputs,
        amplitude=dict.fromkeys(inputs, 1.0),
        gain=full,
        signals=signals if is_boat else (*signals, "z", "w"),
        seed=seed,
        cruise=_full_speed(plant, full["surge"]),
        mass=mass,
        on_vehicle=True,
        axis_names={name: channel for channel in inputs for name in _NAMES[channel]},
    )


def _full_speed(plant: Plant, force: float) -> float:
    """Return the steady speed ahead [m/s] under *force* [N]."""
    beta, beta2 = (plant.parameters[f"surge.{name}"] for name in ("beta", "beta2"))
    if beta2 <= 0.0 >= beta:
        return 0.0
    if beta2 > 0.0:
        return (math.sqrt(beta**2 + 4.0 * beta2 * force) - beta) / (2.0 * beta2)
    return force / beta
