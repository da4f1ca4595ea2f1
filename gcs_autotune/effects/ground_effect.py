"""Ground effect: drag grows close to the bottom."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from gcs_autotune.effects.axes import drag_names
from gcs_autotune.effects.effect import Applied, Curve, Drive, Effect, Family, Quantity, Scene
from gcs_autotune.models.coupled.derivatives import DEPTH
from gcs_autotune.sname import DOFS

__all__ = ["GroundEffect"]

LENGTHS = (0.1, 0.3, 0.8)
"""Lengths to begin from, in shares of the depths visited."""


class GroundEffect(Effect):
    """All drag in one equation times ``1 + strength exp(-(bottom - z)/length)``: water squeezed against the bottom.

    ``bottom`` is the deepest recorded ``z``: where the true bottom lies deeper by h, ``strength`` comes out as
    ``exp(-h/length)`` of that at the bottom, and the motion is the same. Heave simulates its own depth; other
    degrees of freedom, when heave is not simulated, take the recorded one.
    """

    slug: ClassVar[str] = "ground-effect"
    family: ClassVar[Family] = "hydrodynamics"
    meaning: ClassVar[str] = "drag grows close to the bottom or a wall, where water has to be squeezed out of the way"
    parameters: ClassVar[tuple[Quantity, ...]] = (
        Quantity("strength", "1", "drag at the deepest point over drag far above it, less one"),
        Quantity("length", "m", "height above the deepest point at which 37 % of that are left"),
    )
    shown_by: ClassVar[str] = "residual against depth: right high up, too fast in the simulation near the bottom"
    mistaken_for: ClassVar[tuple[str, ...]] = ("quadratic-drag", "net-buoyancy", "tether-pull", "gain-drift")
    separated_by: ClassVar[str] = (
        "the same pushes up and down just above the bottom, a craft's length above it and far up"
    )
    grows_with: ClassVar[tuple[str, ...]] = ("strength",)

    def places(self, scene: Scene) -> tuple[str, ...]:
        """Degrees of freedom with drag, when depth is recorded and changes by more than its noise."""
        low, high = scene.extent.get("z", (0.0, 0.0))
        if not high - low > 8.0 * scene.level.get("z", 0.0):
            return ()
        known = set(scene.form.parameters)
        return tuple(d for d in ("heave", "yaw", "surge", "sway") if d in scene.form.dofs and known & {*drag_names(d)})

    def starts(self, place: str, scene: Scene) -> tuple[Mapping[str, float], ...]:
        """Drag doubled at the bottom, over three heights."""
        low, high = scene.extent["z"]
        return tuple({"strength": 1.0, "length": share * (high - low)} for share in LENGTHS)

    def bounds(self, place: str, scene: Scene) -> Mapping[str, tuple[float, float]]:
        """Drag grows, within a part of the depths visited or little more."""
        low, high = scene.extent["z"]
        return {"strength": (0.0, 50.0), "length": (0.02 * (high - low), 2.0 * (high - low))}

    def constants(self, place: str, scene: Scene) -> Mapping[str, float]:
        """The deepest recorded depth, and whether the simulation has a depth of its own."""
        return {"bottom": scene.extent["z"][1], "dives": float("heave" in scene.form.dofs)}

    def inputs(self, own: Applied) -> tuple[str, ...]:
        """The recorded depth, for a craft whose heave is not simulated."""
        return () if own["dives"] else (DEPTH,)

    def drive(self, own: Applied, drive: Drive) -> Drive:
        """Add the recorded depth, between its stamps the mean of both."""
        if own["dives"]:
            return drive
        z = drive.measured["z"]
        known = np.isfinite(z.values)
        finer = drive.on(np.union1d(drive.t, z.t[known]))
        middle = 0.5 * (finer.t + np.append(finer.t[1:], finer.t[-1]))
        return finer.with_channel(DEPTH, np.interp(middle, z.t[known], z.values[known]))

    def derivatives(self, own: Applied) -> Mapping[str, float]:
        """``wall_Z`` with its ``reach`` and ``bottom``."""
        return {f"wall_{DOFS[own.place].force}": own["strength"], "reach": own["length"], "bottom": own["bottom"]}

    def curve(self, own: Applied, scene: Scene) -> Curve:
        """Drag over height."""
        low, high = scene.extent["z"]
        height = np.linspace(0.0, high - low, 121)
        drag = 1.0 + own["strength"] * np.exp(-height / own["length"])
        name, far = "height above the deepest point [m]", "drag over that far from the bottom"
        return Curve(height, drag, name, far, "Ground effect", plain=np.ones(len(height)))
