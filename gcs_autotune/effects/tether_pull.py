"""Tether pull: something holds the craft like a spring."""

from __future__ import annotations

from collections.abc import Mapping
from math import inf
from typing import ClassVar

import numpy as np

from gcs_autotune.effects.axes import force_scale, force_unit, sense, sense_of, stiffness_unit
from gcs_autotune.effects.effect import Applied, Curve, Effect, Family, Quantity, Scene
from gcs_autotune.sname import DOFS

__all__ = ["TetherPull"]

PLANE = "surge+sway"

STRENGTH = 0.3
"""Pull to begin from over the range of positions visited, in shares of the largest force."""

AWAY = 5.0
"""How far from the middle of the positions an anchor may lie, in ranges visited; farther off it is a constant force."""


class TetherPull(Effect):
    """``- stiffness (position - anchor)`` in one degree of freedom, or towards a place ``x``, ``y`` on the plane.

    On the plane the pull is earth-fixed and turned into the body frame; a craft that does not turn heads north.
    """

    slug: ClassVar[str] = "tether-pull"
    family: ClassVar[Family] = "environment"
    meaning: ClassVar[str] = "a spring holds the craft: the pull goes with the distance from where the tether is slack"
    parameters: ClassVar[tuple[Quantity, ...]] = (
        Quantity("stiffness", "force/m or moment/rad", "pull per distance"),
        Quantity("anchor", "m or rad", "position without pull"),
        Quantity("x", "m", "the same on the plane, north"),
        Quantity("y", "m", "the same on the plane, east"),
    )
    shown_by: ClassVar[str] = "residual against position: a slope back to one place; left alone it returns there"
    mistaken_for: ClassVar[tuple[str, ...]] = ("input-bias", "net-buoyancy", "steady-current", "wind-moment")
    separated_by: ClassVar[str] = "let go without command at three positions (headings, depths): does it come back?"
    grows_with: ClassVar[tuple[str, ...]] = ("stiffness",)

    def places(self, scene: Scene) -> tuple[str, ...]:
        """Yaw and heave with their position measured; surge by itself on a line; surge and sway on the plane."""
        form, seen = scene.form, set(scene.signals)
        found: list[str] = [d for d in ("yaw", "heave") if d in form.dofs and DOFS[d].position in seen]
        if "surge" in form.dofs and not {"sway", "yaw"} & set(form.dofs) and "x" in seen:
            found.append("surge")
        if {"surge", "sway"} <= set(form.dofs) and {"x", "y"} <= seen:
            found.append(PLANE)
        return tuple(d for d in found if d == PLANE or f"{DOFS[d].force}_{DOFS[d].position}" not in form.parameters)

    def starts(self, place: str, scene: Scene) -> tuple[Mapping[str, float], ...]:
        """Anchored amid the positions visited, and at their ends."""
        if place == PLANE:
            (west, east), (south, north) = scene.extent["y"], scene.extent["x"]
            span = max(east - west, north - south) or 1.0
            stiffness = STRENGTH * max(force_scale(d, scene) for d in ("surge", "sway")) / span
            middle = (0.5 * (south + north), 0.5 * (west + east))
            ends = [(n, e) for n in (south, north) for e in (west, east)]
            return tuple({"stiffness": stiffness, "x": n, "y": e} for n, e in (middle, *ends))
        low, high = scene.extent[DOFS[place].position]
        stiffness = STRENGTH * force_scale(place, scene) / ((high - low) or 1.0)
        return tuple({"stiffness": stiffness, "anchor": a} for a in (0.5 * (low + high), low, high))

    def bounds(self, place: str, scene: Scene) -> Mapping[str, tuple[float, float]]:
        """It pulls back, to somewhere not too far off."""
        names = {"x": "x", "y": "y"} if place == PLANE else {"anchor": DOFS[place].position}
        edges = {name: scene.extent[signal] for name, signal in names.items()}
        span = max(high - low for low, high in edges.values()) or 1.0
        reach = {n: (0.5 * (a + b) - AWAY * span, 0.5 * (a + b) + AWAY * span) for n, (a, b) in edges.items()}
        return {"stiffness": (0.0, inf), **reach}

    def constants(self, place: str, scene: Scene) -> Mapping[str, float]:
        """Which sign pulls back."""
        return sense(place, scene) if place != PLANE else {}

    def derivatives(self, own: Applied) -> Mapping[str, float]:
        """``N_psi`` and ``N_0``, ``Z_z`` and ``Z_0``; on the plane positions times sine and cosine of the heading."""
        k = sense_of(own) * own["stiffness"]
        if own.place != PLANE:
            d = DOFS[own.place]
            return {f"{d.force}_{d.position}": -k, f"{d.force}_0": k * own["anchor"]}
        north, east = k * own["x"], k * own["y"]
        return {
            "X_xcospsi": -k, "X_ysinpsi": -k, "X_cospsi": north, "X_sinpsi": east,
            "Y_xsinpsi": k, "Y_ycospsi": -k, "Y_sinpsi": -north, "Y_cospsi": east,
        }  # fmt: skip

    def curve(self, own: Applied, scene: Scene) -> Curve:
        """Pull over position, on the plane over distance."""
        if own.place == PLANE:
            far = max(high - low for low, high in (scene.extent["x"], scene.extent["y"])) or 1.0
            distance = np.linspace(0.0, far, 61)
            unit = force_unit("surge", scene)
            return Curve(distance, own["stiffness"] * distance, "distance [m]", f"pull [{unit}]", "Tether pull")
        d = DOFS[own.place]
        x = np.linspace(*scene.extent[d.position], 61)
        pull = -own["stiffness"] * (x - own["anchor"])
        unit = force_unit(own.place, scene)
        return Curve(x, pull, f"{d.position} [{d.position_unit}]", f"pull [{unit}]", "Tether pull")

    def unit_of(self, name: str, place: str, scene: Scene) -> str:
        """Force per distance, and that of the position."""
        first = place.split("+")[0]
        return stiffness_unit(first, scene) if name == "stiffness" else DOFS[first].position_unit
