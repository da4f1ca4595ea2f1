"""Saturation: large commands do no more than a limit."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from gcs_autotune.effects.actuator import Array, Characteristic
from gcs_autotune.effects.effect import INPUT, Applied, Quantity, Scene

__all__ = ["Saturation"]

LEAST = 0.05
"""An actuator gives at least this share of the largest command."""


class Saturation(Characteristic):
    """What acts is the command clipped to ``-limit .. limit``."""

    slug: ClassVar[str] = "saturation"
    title: ClassVar[str] = "Saturation"
    meaning: ClassVar[str] = (
        "commands beyond a limit do no more than the limit: end stops, output limits, a weak battery"
    )
    parameters: ClassVar[tuple[Quantity, ...]] = (Quantity("limit", INPUT, "largest command that is carried out"),)
    shown_by: ClassVar[str] = (
        "residual against command: zero up to the limit, then against the command and growing with it"
    )
    mistaken_for: ClassVar[tuple[str, ...]] = ("quadratic-drag", "rudder-stall", "quadratic-actuator", "rate-limit")
    separated_by: ClassVar[str] = (
        "steps from rest to a quarter, half, three quarters and all of full command, each held until the speed is "
        "steady, both ways: with a limit the largest steps start equally hard; with drag they start harder and end "
        "less fast"
    )

    def starts(self, place: str, scene: Scene) -> tuple[Mapping[str, float], ...]:
        """Shares of the largest command."""
        return tuple({"limit": share * scene.swing[place]} for share in (0.2, 0.4, 0.6, 0.8, 0.93))

    def bounds(self, place: str, scene: Scene) -> Mapping[str, tuple[float, float]]:
        """A twentieth of the largest command to all of it."""
        return {"limit": (LEAST * scene.swing[place], scene.swing[place])}

    def acting(self, own: Applied, u: Array) -> Array:
        """Clip the commands."""
        return np.clip(u, -own["limit"], own["limit"])
