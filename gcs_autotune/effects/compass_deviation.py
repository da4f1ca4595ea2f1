"""Compass deviation: the compass errs with the heading."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from gcs_autotune.effects.effect import Applied, Array, Curve, Effect, Family, Observed, Quantity, Scene, columns_of

__all__ = ["CompassDeviation"]


class CompassDeviation(Effect):
    """The compass shows ``psi + A + B sin(psi) + C cos(psi)``: iron and currents aboard.

    ``A``, a misaligned compass, is sought only where a track, ``x`` and ``y``, tells it from another choice of north.
    At ``"psi+u+v"`` the velocities are a satellite receiver's, turned into the body by the same compass, as in
    :mod:`gcs_autotune.models.coupled.compass`.
    """

    slug: ClassVar[str] = "compass-deviation"
    family: ClassVar[Family] = "sensor"
    meaning: ClassVar[str] = "the compass errs with sine and cosine of the heading: iron and currents aboard"
    parameters: ClassVar[tuple[Quantity, ...]] = (
        Quantity("B", "rad", "share that goes with the sine of the heading"),
        Quantity("C", "rad", "share that goes with its cosine"),
        Quantity("A", "rad", "constant share, a misaligned compass: only where a track is measured"),
    )
    grows_with: ClassVar[tuple[str, ...]] = ("B", "C")
    shown_by: ClassVar[str] = "heading residual against heading: one wave per turn, while the gyro fits"
    mistaken_for: ClassVar[tuple[str, ...]] = ("wind-moment", "steady-current", "tether-pull")
    separated_by: ClassVar[str] = "two slow full turns, one each way"

    def places(self, scene: Scene) -> tuple[str, ...]:
        """The heading, when it is measured; with it the velocities, when both are."""
        if "psi" not in scene.signals:
            return ()
        return ("psi", "psi+u+v") if {"u", "v"} <= set(scene.signals) else ("psi",)

    def starts(self, place: str, scene: Scene) -> tuple[Mapping[str, float], ...]:
        """A few degrees each way."""
        A = {"A": 0.0} if _tracked(scene) else {}
        return ({"B": 0.05, "C": 0.0, **A}, {"B": 0.0, "C": 0.05, **A}, {"B": -0.05, "C": -0.05, **A})

    def bounds(self, place: str, scene: Scene) -> Mapping[str, tuple[float, float]]:
        """Beyond 40 degrees a compass is broken, not deviating."""
        names = ("B", "C", "A") if _tracked(scene) else ("B", "C")
        return dict.fromkeys(names, (-0.7, 0.7))

    def observe(self, own: Applied, seen: Observed) -> Observed:
        """Add the deviation to the heading, and turn the velocities that were turned by it."""
        psi = seen.signals["psi"]
        d = _deviation(own, psi)
        shown = seen.with_signal("psi", psi + d)
        if len(columns_of(own.place)) == 1:
            return shown
        u, v = seen.signals["u"], seen.signals["v"]
        cosine, sine = np.cos(d), np.sin(d)
        return shown.with_signal("u", cosine * u + sine * v).with_signal("v", cosine * v - sine * u)

    def curve(self, own: Applied, scene: Scene) -> Curve:
        """The deviation card."""
        psi = np.linspace(0.0, 2.0 * np.pi, 181)
        return Curve(psi, _deviation(own, psi), "heading [rad]", "deviation [rad]", "Deviation card", polar=True)


def _deviation(own: Applied, psi: Array) -> Array:
    d: Array = own.values.get("A", 0.0) + own["B"] * np.sin(psi) + own["C"] * np.cos(psi)
    return d


def _tracked(scene: Scene) -> bool:
    return {"x", "y"} <= set(scene.signals)
