"""Dead zone: nothing happens near zero command."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from gcs_autotune.effects.effect import INPUT, Applied, Curve, Drive, Effect, Family, Quantity, Scene

__all__ = ["DeadZone"]


class DeadZone(Effect):
    """The actuator answers to what exceeds ``width`` only: ``sign(u) max(|u| - width, 0)``."""

    slug: ClassVar[str] = "dead-zone"
    family: ClassVar[Family] = "actuator"
    meaning: ClassVar[str] = "commands smaller than a threshold do nothing, larger ones lose that much"
    parameters: ClassVar[tuple[Quantity, ...]] = (Quantity("width", INPUT, "half-width of the dead zone"),)
    shown_by: ClassVar[str] = "residual against command: a kink either side of zero"
    mistaken_for: ClassVar[tuple[str, ...]] = ("backlash", "quadratic-actuator", "linear-drag")
    separated_by: ClassVar[str] = "steps of several sizes, from one small enough to do nothing to full command"

    def places(self, scene: Scene) -> tuple[str, ...]:
        """Every input."""
        return tuple(scene.inputs)

    def starts(self, place: str, scene: Scene) -> tuple[Mapping[str, float], ...]:
        """Shares of the largest command."""
        return tuple({"width": share * scene.swing[place]} for share in (0.03, 0.1, 0.25, 0.5))

    def bounds(self, place: str, scene: Scene) -> Mapping[str, tuple[float, float]]:
        """Less than the largest command."""
        return {"width": (0.0, 0.95 * scene.swing[place])}

    def drive(self, own: Applied, drive: Drive) -> Drive:
        """Take the width off every command."""
        u = drive.channels[own.place]
        return drive.with_channel(own.place, np.sign(u) * np.maximum(np.abs(u) - own["width"], 0.0))

    def curve(self, own: Applied, scene: Scene) -> Curve:
        """Effective over nominal command."""
        u = np.linspace(-scene.swing[own.place], scene.swing[own.place], 201)
        y = np.sign(u) * np.maximum(np.abs(u) - own["width"], 0.0)
        unit = scene.inputs[own.place]
        return Curve(u, y, f"{own.place} commanded [{unit}]", f"{own.place} acting [{unit}]", "Dead zone", plain=u)
