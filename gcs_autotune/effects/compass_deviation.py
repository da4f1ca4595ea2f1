"""Compass deviation: the compass errs with the heading."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from gcs_autotune.effects.effect import Applied, Curve, Effect, Family, Observed, Quantity, Scene

__all__ = ["CompassDeviation"]


class CompassDeviation(Effect):
    """The compass shows ``psi + B sin(psi) + C cos(psi)``: iron and currents aboard."""

    slug: ClassVar[str] = "compass-deviation"
    family: ClassVar[Family] = "sensor"
    meaning: ClassVar[str] = "the compass errs with sine and cosine of the heading: iron and currents aboard"
    parameters: ClassVar[tuple[Quantity, ...]] = (
        Quantity("B", "rad", "share that goes with the sine of the heading"),
        Quantity("C", "rad", "share that goes with its cosine"),
    )
    shown_by: ClassVar[str] = "heading residual against heading: one wave per turn, while the gyro fits"
    mistaken_for: ClassVar[tuple[str, ...]] = ("wind-moment", "steady-current", "tether-pull")
    separated_by: ClassVar[str] = "two slow full turns, one each way"

    def places(self, scene: Scene) -> tuple[str, ...]:
        """The heading, when it is measured."""
        return ("psi",) if "psi" in scene.signals else ()

    def starts(self, place: str, scene: Scene) -> tuple[Mapping[str, float], ...]:
        """A few degrees each way."""
        return ({"B": 0.05, "C": 0.0}, {"B": 0.0, "C": 0.05}, {"B": -0.05, "C": -0.05})

    def bounds(self, place: str, scene: Scene) -> Mapping[str, tuple[float, float]]:
        """Beyond 40 degrees a compass is broken, not deviating."""
        return {"B": (-0.7, 0.7), "C": (-0.7, 0.7)}

    def observe(self, own: Applied, seen: Observed) -> Observed:
        """Add the deviation to the heading."""
        psi = seen.signals["psi"]
        return seen.with_signal("psi", psi + own["B"] * np.sin(psi) + own["C"] * np.cos(psi))

    def curve(self, own: Applied, scene: Scene) -> Curve:
        """The deviation card."""
        psi = np.linspace(0.0, 2.0 * np.pi, 181)
        d = own["B"] * np.sin(psi) + own["C"] * np.cos(psi)
        return Curve(psi, d, "heading [rad]", "deviation [rad]", "Deviation card", polar=True)
