"""A whole vehicle as a setting for effects: inputs are shares of full, signals what its sensors measure."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from sitl.effects.effect import Setting

if TYPE_CHECKING:
    from sitl.rig import Rig

__all__ = ["describe_vehicle"]

_CHANNELS = {"yaw": "N", "surge": "X", "heave": "Z"}
_NAMES = {
    "N": ("steering", "rudder", "yaw", "delta"),
    "X": ("throttle", "surge"),
    "Z": ("vertical", "heave"),
}


def describe_vehicle(vehicle: Rig, seed: str) -> Setting:
    """Return what effects may know of *vehicle* at power-up."""
    body, full = vehicle.body, vehicle.actuators.full
    inputs = {_CHANNELS[dof]: dof for dof in full}
    signals = ("psi", "r", "phi", "theta", "p", "q", "u", *["v"][: body.sways], "x", "y")
    return Setting(
        motion=body,
        axes={dof: getattr(body, dof) for dof in (*full, *["sway"][: body.sways])},
        inputs=inputs,
        swing=dict.fromkeys(inputs, 1.0),
        gain=full,
        signals=signals if vehicle.data.is_boat else (*signals, "z", "w"),
        seed=seed,
        cruise=_full_speed(vehicle),
        bottom=body.world.bottom,
        on_vehicle=True,
        axis_names={name: channel for channel in inputs for name in _NAMES[channel]},
    )


def _full_speed(vehicle: Rig) -> float:
    """Return the speed ahead [m/s] that full throttle holds."""
    axis, force = vehicle.body.surge, vehicle.actuators.full["surge"]
    if axis.beta2 <= 0.0 >= axis.beta:
        return 0.0
    if axis.beta2 > 0.0:
        return (math.sqrt(axis.beta**2 + 4.0 * axis.beta2 * force) - axis.beta) / (2.0 * axis.beta2)
    return force / axis.beta
