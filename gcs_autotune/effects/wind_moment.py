"""Wind moment: the wind turns the bow."""

from __future__ import annotations

from collections.abc import Mapping
from math import cos, inf, pi, sin
from typing import ClassVar

import numpy as np

from gcs_autotune.effects.axes import force_scale, force_unit, sense, sense_of
from gcs_autotune.effects.effect import INPUT, Applied, Curve, Effect, Family, Quantity, Scene

__all__ = ["WindMoment"]

DIRECTIONS = 6
"""Directions to begin from, evenly round."""


class WindMoment(Effect):
    """``N += strength sin(direction - psi)``: it turns the bow towards ``direction``, upwind or down.

    Which of the two is the hull's affair. Needs a measured heading. ``direction`` counts from north over east; a fit
    may leave it outside [0, 2 pi).
    """

    slug: ClassVar[str] = "wind-moment"
    family: ClassVar[Family] = "environment"
    meaning: ClassVar[str] = "wind on the hull turns the bow towards one direction, most when lying across it"
    parameters: ClassVar[tuple[Quantity, ...]] = (
        Quantity("strength", INPUT, "moment when the wind is abeam"),
        Quantity("direction", "rad", "heading the bow is turned towards"),
    )
    shown_by: ClassVar[str] = "yaw residual against heading: one wave per turn, in the gyro as well as in the compass"
    mistaken_for: ClassVar[tuple[str, ...]] = ("input-bias", "compass-deviation", "tether-pull", "gyro-bias")
    separated_by: ClassVar[str] = "two slow full turns, one each way, and half a minute without command on two headings"
    grows_with: ClassVar[tuple[str, ...]] = ("strength",)

    def places(self, scene: Scene) -> tuple[str, ...]:
        """Yaw, with a measured heading."""
        there = {"N_sinpsi", "N_cospsi"} & set(scene.form.parameters)
        return ("yaw",) if "yaw" in scene.form.dofs and "psi" in scene.signals and not there else ()

    def starts(self, place: str, scene: Scene) -> tuple[Mapping[str, float], ...]:
        """A fifth of the largest command, from all round."""
        strength = 0.2 * force_scale(place, scene)
        turns = (2.0 * pi * k / DIRECTIONS for k in range(DIRECTIONS))
        return tuple({"strength": strength, "direction": d if d <= pi else d - 2.0 * pi} for d in turns)

    def bounds(self, place: str, scene: Scene) -> Mapping[str, tuple[float, float]]:
        """Strength is positive, the direction says the rest."""
        return {"strength": (0.0, inf), "direction": (-3.0 * pi, 3.0 * pi)}

    def constants(self, place: str, scene: Scene) -> Mapping[str, float]:
        """Which sign turns to starboard."""
        return sense(place, scene)

    def derivatives(self, own: Applied) -> Mapping[str, float]:
        """``N_cospsi`` and ``N_sinpsi``: the sine of a difference taken apart."""
        strength = sense_of(own) * own["strength"]
        return {"N_cospsi": strength * sin(own["direction"]), "N_sinpsi": -strength * cos(own["direction"])}

    def curve(self, own: Applied, scene: Scene) -> Curve:
        """The wind rose: moment over heading."""
        psi = np.linspace(0.0, 2.0 * np.pi, 181)
        moment = own["strength"] * np.sin(own["direction"] - psi)
        unit = force_unit(own.place, scene)
        return Curve(psi, moment, "heading [rad]", f"moment to starboard [{unit}]", "Wind moment", polar=True)

    def unit_of(self, name: str, place: str, scene: Scene) -> str:
        """That of the moment, and of the heading."""
        return force_unit(place, scene) if name == "strength" else "rad"
