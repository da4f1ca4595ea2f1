"""Input delay: commands act later."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from gcs_autotune.effects.actuator import Actuator, horizon
from gcs_autotune.effects.effect import Applied, Curve, Drive, Quantity, Scene
from gcs_autotune.effects.held import redrawn

__all__ = ["InputDelay"]


class InputDelay(Actuator):
    """The command acts ``delay`` later, the first one before that; exact, as commands are held."""

    slug: ClassVar[str] = "input-delay"
    meaning: ClassVar[str] = "commands act later than they were sent: radio, autopilot loops, motor controller"
    parameters: ClassVar[tuple[Quantity, ...]] = (Quantity("delay", "s", "time from command to action"),)
    grows_with: ClassVar[tuple[str, ...]] = ("delay",)
    shown_by: ClassVar[str] = "residual right after every change of command: the motion begins late, then runs in step"
    mistaken_for: ClassVar[tuple[str, ...]] = (
        "actuator-lag",
        "measurement-delay",
        "time-offset",
        "rate-limit",
        "backlash",
    )
    separated_by: ClassVar[str] = (
        "full steps from rest with ten samples or more per time constant: a delay leaves the craft still, then starts "
        "it at full pace; a lag starts it at once and gently. Inputs stepped one by one tell it from late clocks"
    )

    def starts(self, place: str, scene: Scene) -> tuple[Mapping[str, float], ...]:
        """From a sample to the craft's own pace."""
        return tuple({"delay": float(d)} for d in np.geomspace(*horizon(scene), 5))

    def bounds(self, place: str, scene: Scene) -> Mapping[str, tuple[float, float]]:
        """None, to twice the craft's pace."""
        return {"delay": (0.0, 2.0 * horizon(scene)[1])}

    def drive(self, own: Applied, drive: Drive) -> Drive:
        """Shift the changes of the channel; a lone channel keeps no other stamps."""
        u = drive.channels[own.place]
        changes = np.r_[True, np.diff(u) != 0.0]
        t, u = drive.t[changes] + own["delay"], u[changes]
        t[0] = drive.t[0]
        return redrawn(drive, own.place, t, u)

    def curve(self, own: Applied, scene: Scene) -> Curve:
        """A step, commanded and acting."""
        t = np.linspace(-0.5, 2.5, 601) * max(own["delay"], scene.interval)
        acting, commanded = (t >= own["delay"]).astype(float), (t >= 0.0).astype(float)
        return Curve(t, acting, "time [s]", f"{own.place}, shares of a step [1]", "Input delay", plain=commanded)
