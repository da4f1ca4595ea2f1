"""Gain drift: the actuator weakens as time goes on."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from gcs_autotune.effects.actuator import Gradual, last_stamp
from gcs_autotune.effects.between import fading
from gcs_autotune.effects.effect import Applied, Curve, Drive, Quantity, Scene
from gcs_autotune.effects.held import redrawn

__all__ = ["GainDrift"]

LEAST = 0.05
"""What is left of the gain in the end."""


class GainDrift(Gradual):
    """Commands act times ``1 - rate (t - t_0)``, ``t_0`` the run's first stamp, never less than a twentieth."""

    slug: ClassVar[str] = "gain-drift"
    meaning: ClassVar[str] = "thrust weakens (or grows) in the course of a run: the battery sags, a motor heats up"
    parameters: ClassVar[tuple[Quantity, ...]] = (Quantity("rate", "1/s", "share of the first gain lost per second"),)
    grows_with: ClassVar[tuple[str, ...]] = ("rate",)
    shown_by: ClassVar[str] = "residual against time: follows the command in the beginning and opposes it in the end"
    mistaken_for: ClassVar[tuple[str, ...]] = (
        "mass-change",
        "time-scale",
        "quadratic-drag",
        "speed-dependent-steering",
    )
    separated_by: ClassVar[str] = (
        "the same full steps at the beginning and at the end of one long run, and once more with a fresh battery: "
        "with a weaker gain they start and end slower, with a larger mass they start slower and end equally fast"
    )

    def starts(self, place: str, scene: Scene) -> tuple[Mapping[str, float], ...]:
        """A third and most of the gain lost within the longest run, and a third gained."""
        return tuple({"rate": share / scene.duration} for share in (0.3, 0.8, -0.3))

    def bounds(self, place: str, scene: Scene) -> Mapping[str, tuple[float, float]]:
        """From doubling within the longest run to running out in a third of it."""
        return {"rate": (-1.0 / scene.duration, 3.0 / scene.duration)}

    def drive(self, own: Applied, drive: Drive) -> Drive:
        """Let the commands fade."""
        u = drive.channels[own.place]
        resolution = self.resolution(own, u)
        faded = fading(drive.t, u, drive.start, last_stamp(drive), own["rate"], LEAST, resolution)
        return redrawn(drive, own.place, *faded)

    def curve(self, own: Applied, scene: Scene) -> Curve:
        """Gain over time."""
        t = np.linspace(0.0, scene.duration, 201)
        gain = np.maximum(1.0 - own["rate"] * t, LEAST)
        return Curve(t, gain, "time in the run [s]", f"gain of {own.place} [1]", "Gain drift", plain=np.ones_like(t))
