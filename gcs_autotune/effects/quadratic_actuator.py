"""Quadratic actuator: thrust goes as the square of the propeller's speed."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from gcs_autotune.effects.actuator import Array, Characteristic
from gcs_autotune.effects.effect import Applied, Quantity, Scene

__all__ = ["QuadraticActuator"]


class QuadraticActuator(Characteristic):
    """``(1 - share) u + share u|u|/u_ref``: from proportional (share 0) to thrust as ``n|n|`` (share 1).

    ``u_ref`` is the largest command of the runs. The affine thruster ``a |n| n + b n`` of Miskovic2010,
    (2.7), with the gain at full command kept at 1.
    """

    slug: ClassVar[str] = "quadratic-actuator"
    title: ClassVar[str] = "Thrust curve"
    meaning: ClassVar[str] = "thrust goes as the square of the command (n|n|): half command gives less than half thrust"
    parameters: ClassVar[tuple[Quantity, ...]] = (
        Quantity("share", "1", "quadratic share of the thrust at full command"),
    )
    grows_with: ClassVar[tuple[str, ...]] = ("share",)
    shown_by: ClassVar[str] = (
        "residual against command bends: too little thrust at small commands, too much at large ones"
    )
    mistaken_for: ClassVar[tuple[str, ...]] = ("dead-zone", "quadratic-drag", "saturation", "speed-dependent-steering")
    separated_by: ClassVar[str] = (
        "steps from rest to a quarter, half, three quarters and all of full command: how hard each starts, before "
        "there is any speed, is the thrust curve itself; drag shows only in how fast each ends"
    )

    def starts(self, place: str, scene: Scene) -> tuple[Mapping[str, float], ...]:
        """Partly, and wholly."""
        return ({"share": 0.4}, {"share": 0.9})

    def bounds(self, place: str, scene: Scene) -> Mapping[str, tuple[float, float]]:
        """A little beyond the physical 0 to 1, so that a fit can end at either."""
        return {"share": (-0.2, 1.2)}

    def constants(self, place: str, scene: Scene) -> Mapping[str, float]:
        """The largest command."""
        return {"u_ref": scene.swing[place]}

    def acting(self, own: Applied, u: Array) -> Array:
        """Bend the commands."""
        return u * ((1.0 - own["share"]) + own["share"] * np.abs(u) / own["u_ref"])
