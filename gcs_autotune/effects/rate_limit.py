"""Rate limit: the actuator moves no faster than so."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from gcs_autotune.effects.actuator import Gradual, horizon
from gcs_autotune.effects.between import limited
from gcs_autotune.effects.effect import INPUT, Applied, Curve, Drive, Quantity, Scene
from gcs_autotune.effects.held import redrawn

__all__ = ["RateLimit"]


class RateLimit(Gradual):
    """The actuator runs after the command at ``rate`` until it has reached it; it starts at the first command."""

    slug: ClassVar[str] = "rate-limit"
    meaning: ClassVar[str] = (
        "the actuator runs after its command at a fixed speed: a slow servo, a ramp in the motor controller"
    )
    parameters: ClassVar[tuple[Quantity, ...]] = (Quantity("rate", f"{INPUT}/s", "fastest change of what acts"),)
    shown_by: ClassVar[str] = "residual after changes of command: the larger the change, the longer it lasts"
    mistaken_for: ClassVar[tuple[str, ...]] = ("actuator-lag", "input-delay", "saturation", "backlash")
    separated_by: ClassVar[str] = (
        "steps of a quarter of full command and full reversals: a rate limit makes large steps late in proportion and "
        "small ones hardly, lag and delay make all equally late"
    )

    def starts(self, place: str, scene: Scene) -> tuple[Mapping[str, float], ...]:
        """From zero to full in less than a sample to twice the craft's pace."""
        shortest, longest = horizon(scene)
        return tuple({"rate": float(scene.swing[place] / s)} for s in np.geomspace(0.6 * shortest, 2.0 * longest, 5))

    def bounds(self, place: str, scene: Scene) -> Mapping[str, tuple[float, float]]:
        """From zero to full in a fiftieth of a sample to ten times the craft's pace."""
        shortest, longest = horizon(scene)
        return {"rate": (0.1 * scene.swing[place] / longest, 50.0 * scene.swing[place] / shortest)}

    def drive(self, own: Applied, drive: Drive) -> Drive:
        """Run after the command."""
        u = drive.channels[own.place]
        return redrawn(drive, own.place, *limited(drive.t, u, own["rate"], self.resolution(own, u)))

    def curve(self, own: Applied, scene: Scene) -> Curve:
        """A step from zero to full command, commanded and acting."""
        full = scene.swing[own.place]
        t = np.linspace(-0.5, 2.0, 501) * full / own["rate"]
        commanded = np.where(t >= 0.0, full, 0.0)
        acting = np.clip(own["rate"] * t, 0.0, full)
        return Curve(t, acting, "time [s]", f"{own.place} [{scene.inputs[own.place]}]", "Rate limit", plain=commanded)
