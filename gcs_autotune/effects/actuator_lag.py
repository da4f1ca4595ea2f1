"""Actuator lag: what acts follows the command as a first-order lag."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from gcs_autotune.effects.actuator import Gradual, horizon
from gcs_autotune.effects.between import following
from gcs_autotune.effects.effect import Applied, Curve, Drive, Quantity, Scene
from gcs_autotune.effects.held import redrawn

__all__ = ["ActuatorLag"]

INSTANT = 1e-6
"""A lag shorter than this [s] is none."""


class ActuatorLag(Gradual):
    """What acts follows the command with ``time_constant``; it starts at the first command."""

    slug: ClassVar[str] = "actuator-lag"
    meaning: ClassVar[str] = "thrust or rudder follow the command gradually: propeller and water take time to speed up"
    parameters: ClassVar[tuple[Quantity, ...]] = (
        Quantity("time_constant", "s", "time until 63 % of a step in command acts"),
    )
    grows_with: ClassVar[tuple[str, ...]] = ("time_constant",)
    shown_by: ClassVar[str] = "residual after every change of command: the motion bends in gently where it should kink"
    mistaken_for: ClassVar[tuple[str, ...]] = (
        "input-delay",
        "rate-limit",
        "measurement-delay",
        "time-offset",
        "mass-change",
    )
    separated_by: ClassVar[str] = (
        "full steps from rest, recorded ten times per time constant or faster, once more at half command: a lag bends "
        "the start at once and equally at both sizes; a delay holds it still, a rate limit makes the larger step the "
        "later one"
    )

    def starts(self, place: str, scene: Scene) -> tuple[Mapping[str, float], ...]:
        """From a sample to the craft's own pace."""
        return tuple({"time_constant": float(T)} for T in np.geomspace(*horizon(scene), 4))

    def bounds(self, place: str, scene: Scene) -> Mapping[str, tuple[float, float]]:
        """None, to five times the craft's pace."""
        return {"time_constant": (0.0, 5.0 * horizon(scene)[1])}

    def drive(self, own: Applied, drive: Drive) -> Drive:
        """Follow the command."""
        u = drive.channels[own.place]
        if own["time_constant"] < INSTANT:
            return drive
        return redrawn(drive, own.place, *following(drive.t, u, own["time_constant"], self.resolution(own, u)))

    def curve(self, own: Applied, scene: Scene) -> Curve:
        """A step, commanded and acting."""
        T = max(own["time_constant"], INSTANT)
        t = np.linspace(-1.0, 5.0, 601) * T
        commanded = (t >= 0.0).astype(float)
        acting = -np.expm1(-np.maximum(t, 0.0) / T)
        return Curve(t, acting, "time [s]", f"{own.place}, shares of a step [1]", "Actuator lag", plain=commanded)
