"""The vessels: boats of one shape in five sizes, and a light and a loaded BlueROV2.

Boats of one shape have the same Nomoto K' = K L/U and T' = T U/L, so that K T is the same for all at one speed: a boat
that takes longer to turn also turns slower. Charlie (T = 3.3 s, 12 deg/s at full rudder) sets the product.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from sitl import load_vehicle
from sitl.catalogue import VehicleData

__all__ = ["FLEET", "Job", "Vessel"]

CHARLIE_TURN = math.radians(12.2) * 3.3
"""Turn rate at full rudder [rad/s] times time constant [s]."""


@dataclass(frozen=True, slots=True)
class Job:
    """One axis of one vessel: its step [rad or m], and the duration of step and step back [s] each."""

    axis: str
    step: float
    duration: float
    calm: Mapping[str, float]
    """Soft gains for the wait before the step."""
    settle: float
    near: float
    """Largest error before the step, as a fraction of it.

    The integral or dead-band error of one flight must not affect the next.
    """
    pairs: int = 1
    """Pairs of steps that are averaged: more for sticking thrusters, whose steps are less repeatable."""


@dataclass(frozen=True, slots=True)
class Vessel:
    """A vessel and its axes to tune."""

    name: str
    data: VehicleData
    jobs: tuple[Job, ...]


def _boat(T: float) -> Vessel:
    data = load_vehicle("charlie")
    tables: dict[str, Any] = dict(data.tables)
    yaw = dict(tables["yaw"])
    beta = yaw["full_rudder"]["value"] * T / CHARLIE_TURN
    yaw["n2"] = {"value": [16.0, 64.0]}
    yaw["alpha"] = {"value": [beta * T, beta * T]}
    yaw["beta"] = {"value": [beta, beta]}
    tables["yaw"] = yaw
    ff = T / CHARLIE_TURN
    calm = {
        "ATC_STR_RAT_FF": ff,
        "ATC_STR_RAT_P": 0.5 * ff,
        "ATC_STR_RAT_I": 0.1 * ff,
        "ATC_STR_RAT_D": 0.0,
        "ATC_STR_RAT_FLTT": 0.0,
        "ATC_STR_RAT_FLTD": 0.0,
        "ATC_STR_ANG_P": 0.4 / T,
    }
    job = Job("heading", math.radians(30.0), max(30.0, 8.0 * T), calm, 15.0 + 5.0 * T, 0.02)
    return Vessel(f"boat-{T:g}s", replace(data, name=f"boat-{T:g}s", tables=tables), (job,))


def _rov(name: str) -> Vessel:
    heading = Job(
        "heading",
        math.radians(30.0),
        15.0,
        {"ATC_RAT_YAW_P": 0.4, "ATC_RAT_YAW_I": 0.05, "ATC_RAT_YAW_D": 0.0, "ATC_ANG_YAW_P": 2.0},
        10.0,
        0.1,
        pairs=2,
    )
    depth = Job(
        "depth",
        1.0,
        20.0,
        {"PSC_POSZ_P": 1.0, "PSC_VELZ_P": 4.0, "PSC_ACCZ_P": 0.5, "PSC_ACCZ_I": 0.2, "PSC_ACCZ_FF": 0.0},
        20.0,
        math.inf,
        pairs=2,
    )
    return Vessel(name, load_vehicle(name), (heading, depth))


FLEET: Mapping[str, Vessel] = {
    vessel.name: vessel
    for vessel in (*(_boat(T) for T in (0.5, 1.0, 2.0, 4.0, 8.0)), _rov("bluerov2"), _rov("bluerov2-loaded"))
}
