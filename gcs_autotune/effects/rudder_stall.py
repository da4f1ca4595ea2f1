"""Rudder stall: beyond an angle the rudder does less, not more."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from gcs_autotune.effects.actuator import Array, Characteristic, steers
from gcs_autotune.effects.effect import INPUT, Applied, Quantity, Scene

__all__ = ["RudderStall"]


class RudderStall(Characteristic):
    """``u`` up to ``angle``, beyond it ``sign(u) max(angle - drop (|u| - angle), 0)``: the flow has left the blade.

    Miskovic2010, (2.9), has the same shape with sines; near the stall angle the two differ little.
    """

    slug: ClassVar[str] = "rudder-stall"
    title: ClassVar[str] = "Rudder force"
    meaning: ClassVar[str] = "beyond an angle the flow leaves the rudder, and more rudder turns the craft less"
    parameters: ClassVar[tuple[Quantity, ...]] = (
        Quantity("angle", INPUT, "command at which the rudder stalls"),
        Quantity("drop", "1", "loss beyond it, per command in excess"),
    )
    shown_by: ClassVar[str] = "residual against command: none up to an angle, beyond it steeply against the command"
    mistaken_for: ClassVar[tuple[str, ...]] = ("saturation", "quadratic-drag", "asymmetric-thrust", "backlash")
    separated_by: ClassVar[str] = (
        "turns at one speed with the rudder held at a third, half, two thirds, five sixths and all of its largest "
        "angle, both ways: with a stall the rate of turn falls from some angle on, with a saturation it stays, with "
        "drag it still grows"
    )

    def places(self, scene: Scene) -> tuple[str, ...]:
        """Every input that turns the craft."""
        return tuple(n for n in super().places(scene) if steers(n, scene))

    def starts(self, place: str, scene: Scene) -> tuple[Mapping[str, float], ...]:
        """Shares of the largest command, with a gentle and a sudden stall."""
        shares = ((0.35, 0.5), (0.6, 0.5), (0.6, 1.5), (0.8, 0.7), (0.8, 2.0))
        return tuple({"angle": share * scene.swing[place], "drop": drop} for share, drop in shares)

    def bounds(self, place: str, scene: Scene) -> Mapping[str, tuple[float, float]]:
        """A tenth of the largest command to all of it; a ``drop`` of 0 would be a saturation."""
        return {"angle": (0.1 * scene.swing[place], scene.swing[place]), "drop": (0.1, 4.0)}

    def acting(self, own: Applied, u: Array) -> Array:
        """Let the commands beyond the angle drop."""
        size = np.abs(u)
        beyond = np.maximum(own["angle"] - own["drop"] * (size - own["angle"]), 0.0)
        return np.where(size <= own["angle"], u, np.sign(u) * beyond)
