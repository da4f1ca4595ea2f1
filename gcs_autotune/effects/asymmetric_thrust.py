"""Asymmetric thrust: one direction is weaker."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from gcs_autotune.effects.actuator import Array, Characteristic
from gcs_autotune.effects.effect import Applied, Quantity, Scene

__all__ = ["AsymmetricThrust"]

BOTH = 0.02
"""Commands go both ways when the smaller side reaches this share of the larger."""


class AsymmetricThrust(Characteristic):
    """Negative commands act times ``ratio``. Miskovic2010, (2.8), with ``a_b / a_f = b_b / b_f``."""

    slug: ClassVar[str] = "asymmetric-thrust"
    title: ClassVar[str] = "Thrust ahead and astern"
    meaning: ClassVar[str] = "the same command does more one way than the other: propellers are made to push ahead"
    parameters: ClassVar[tuple[Quantity, ...]] = (
        Quantity("ratio", "1", "gain of negative over gain of positive commands"),
    )
    grows_with: ClassVar[tuple[str, ...]] = ("ratio",)
    neutral: ClassVar[Mapping[str, float]] = {"ratio": 1.0}
    shown_by: ClassVar[str] = "residual against command: a kink at zero, straight on either side of it"
    mistaken_for: ClassVar[tuple[str, ...]] = ("input-bias", "backlash", "gyro-bias", "wind-moment")
    separated_by: ClassVar[str] = (
        "equal steps both ways at half and at full command, and as long with none: a bias shifts both sizes equally "
        "and moves the craft without a command, an asymmetry grows with the command and leaves it at rest"
    )

    def places(self, scene: Scene) -> tuple[str, ...]:
        """Every input that was used both ways."""
        return tuple(n for n in super().places(scene) if _both_ways(scene.extent.get(n, (-1.0, 1.0))))

    def starts(self, place: str, scene: Scene) -> tuple[Mapping[str, float], ...]:
        """Weaker and stronger astern."""
        return ({"ratio": 0.6}, {"ratio": 1.5})

    def bounds(self, place: str, scene: Scene) -> Mapping[str, tuple[float, float]]:
        """A twentieth to twenty times."""
        return {"ratio": (0.05, 20.0)}

    def acting(self, own: Applied, u: Array) -> Array:
        """Scale what is negative."""
        return np.where(u < 0.0, own["ratio"] * u, u)


def _both_ways(extent: tuple[float, float]) -> bool:
    low, high = extent
    return min(-low, high) > BOTH * max(-low, high)
