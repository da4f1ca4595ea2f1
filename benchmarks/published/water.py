"""Simulators of the tests, which share no code with the package."""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2] / "tests" / "plants"))

from axis_plants import DEG, Plant, Relay, fly
from regression_plants import DOFS, HORIZONTAL_INPUTS, camera_run, yaw_run
from tug_plants import NOISE, TUG, sea_trials

from gcs_autotune.trial import Channel, Trial

__all__ = [
    "DEG",
    "DOFS",
    "HORIZONTAL_INPUTS",
    "NOISE",
    "TUG",
    "Plant",
    "Relay",
    "camera_run",
    "relay_run",
    "sea_trials",
    "yaw_run",
]

_CHANNELS = {"yaw": ("psi", "rad", "N", "N m"), "heave": ("z", "m", "Z", "N"), "surge": ("x", "m", "X", "N")}


def relay_run(
    plant: Plant,
    relay: Relay,
    duration: float,
    dof: str = "yaw",
    *,
    dt: float = 0.002,
    h: float = 0.002,
    delay: float = 0.0,
) -> Trial:
    """Return a relay experiment of *duration* [s] without noise, sampled every *dt* [s]."""
    t, eta, _, tau = fly(plant, relay, duration, dt=dt, delay=delay, h=h)
    position, unit, force, force_unit = _CHANNELS[dof]
    channels = {position: Channel(position, unit, t, eta), force: Channel(force, force_unit, t, tau)}
    return Trial(f"relay on {dof}", channels, meta={"x_a": relay.x_a})
