"""Steady current: the water moves over the ground, and the craft with it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from gcs_autotune.effects.axes import top_speed
from gcs_autotune.effects.effect import Applied, Curve, Effect, Family, Quantity, Scene

__all__ = ["OVER_GROUND", "THROUGH_WATER", "SteadyCurrent"]

OVER_GROUND, THROUGH_WATER = "over ground", "through water"
"""What the file's ``u``, ``v`` are: from a satellite receiver or a bottom-locked log, or from a paddle wheel."""

FASTEST = 5.0
"""Fastest current looked for [m/s]; the strongest tidal races run at more than that, but nobody tunes a boat there."""

_NAMES: Mapping[str, Mapping[str, str]] = {
    OVER_GROUND: {"V_x": "V_x", "V_y": "V_y"},
    THROUGH_WATER: {"V_x": "drift_x", "V_y": "drift_y"},
}


class SteadyCurrent(Effect):
    """Irrotational and steady: the equations of motion hold for the velocity through the water (Fossen2011, 8.3).

    Speeds over ground then show the current turned into the body; speeds through the water do not, and only positions
    drift. Files with positions and heading but no speeds are the same under either reading; they get the first.
    """

    slug: ClassVar[str] = "steady-current"
    family: ClassVar[Family] = "environment"
    meaning: ClassVar[str] = "the water moves over the ground: the craft is set one way, whatever it steers"
    parameters: ClassVar[tuple[Quantity, ...]] = (
        Quantity("V_x", "m/s", "current towards north"),
        Quantity("V_y", "m/s", "current towards east"),
    )
    shown_by: ClassVar[str] = (
        "position residual grows evenly towards one side; speeds over ground: one wave per turn against heading"
    )
    mistaken_for: ClassVar[tuple[str, ...]] = ("input-bias", "compass-deviation", "tether-pull", "asymmetric-thrust")
    separated_by: ClassVar[str] = "steady straight legs on four headings at one throttle, or drift for two minutes"
    grows_with: ClassVar[tuple[str, ...]] = ("V_x", "V_y")

    def places(self, scene: Scene) -> tuple[str, ...]:
        """Both readings of the speeds, as far as the file can show them apart from a constant force.

        Without a heading only the drift of a position against a measured speed can be told.
        """
        form, seen = scene.form, set(scene.signals)
        if {"V_x", "V_y", "drift_x", "drift_y"} & set(form.parameters) or not {"surge", "sway"} & set(form.dofs):
            return ()
        speeds, positions = seen & {"u", "v"}, seen & {"x", "y"}
        turns = "yaw" in form.dofs and "psi" in seen
        if "yaw" in form.dofs and not turns:
            return ()
        over_ground = turns and (bool(speeds) or len(positions) == 2)
        return (OVER_GROUND,) * over_ground + (THROUGH_WATER,) * bool(speeds and positions)

    def starts(self, place: str, scene: Scene) -> tuple[Mapping[str, float], ...]:
        """Along each axis and between them; either sign by scaling. Only north, or east, for a craft on a line."""
        V = 0.2 * max(top_speed(d, scene) for d in ("surge", "sway") if d in scene.form.dofs)
        if "yaw" in scene.form.dofs or {"surge", "sway"} <= set(scene.form.dofs):
            return tuple({"V_x": a * V, "V_y": b * V} for a, b in ((1.0, 0.0), (0.0, 1.0), (0.7, 0.7), (0.7, -0.7)))
        return ({"V_x": V},) if "surge" in scene.form.dofs else ({"V_y": V},)

    def bounds(self, place: str, scene: Scene) -> Mapping[str, tuple[float, float]]:
        """Water is not that fast."""
        return {"V_x": (-FASTEST, FASTEST), "V_y": (-FASTEST, FASTEST)}

    def derivatives(self, own: Applied) -> Mapping[str, float]:
        """The current of the kernel, seen or unseen by the speeds."""
        names = _NAMES[own.place]
        return {names[n]: v for n, v in own.values.items()}

    def curve(self, own: Applied, scene: Scene) -> Curve:
        """How fast the water carries along each heading."""
        psi = np.linspace(0.0, 2.0 * np.pi, 181)
        along = own.values.get("V_x", 0.0) * np.cos(psi) + own.values.get("V_y", 0.0) * np.sin(psi)
        return Curve(psi, along, "heading [rad]", "current from astern [m/s]", "Current", polar=True)
