"""Dead zone: nothing happens near zero command."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from gcs_autotune.effects.actuator import Array, Characteristic
from gcs_autotune.effects.effect import INPUT, Applied, Quantity, Scene

__all__ = ["DeadZone"]


class DeadZone(Characteristic):
    """The actuator answers to what exceeds ``width`` only: ``sign(u) max(|u| - width, 0)``."""

    slug: ClassVar[str] = "dead-zone"
    title: ClassVar[str] = "Dead zone"
    meaning: ClassVar[str] = "commands smaller than a threshold do nothing, larger ones lose that much"
    parameters: ClassVar[tuple[Quantity, ...]] = (Quantity("width", INPUT, "half-width of the dead zone"),)
    grows_with: ClassVar[tuple[str, ...]] = ("width",)
    shown_by: ClassVar[str] = "residual against command: a kink either side of zero"
    mistaken_for: ClassVar[tuple[str, ...]] = ("backlash", "quadratic-actuator", "linear-drag")
    separated_by: ClassVar[str] = (
        "steps from rest of several sizes, both ways, from one small enough to do nothing to full command, each held "
        "until the speed is steady and begun from zero command, so that play takes no part"
    )

    def starts(self, place: str, scene: Scene) -> tuple[Mapping[str, float], ...]:
        """Shares of the largest command."""
        return tuple({"width": share * scene.swing[place]} for share in (0.03, 0.1, 0.25, 0.5))

    def bounds(self, place: str, scene: Scene) -> Mapping[str, tuple[float, float]]:
        """Less than the largest command."""
        return {"width": (0.0, 0.95 * scene.swing[place])}

    def acting(self, own: Applied, u: Array) -> Array:
        """Take the width off every command."""
        return np.sign(u) * np.maximum(np.abs(u) - own["width"], 0.0)
