"""Mass change: a payload is taken aboard or dropped within a run."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from gcs_autotune.effects.effect import Applied, Curve, Drive, Effect, Family, Quantity, Scene
from gcs_autotune.models.coupled.derivatives import PAYLOAD

__all__ = ["MassChange"]

RATIOS, MOMENTS = (1.5, 0.67), 16
"""Ratios to begin from, at so many moments: between two changes of command nothing tells when, so moments have to lie
about as close as commands do."""


class MassChange(Effect):
    """The whole inertia is ``ratio`` times as large from ``time`` after the run's start on; velocity does not jump."""

    slug: ClassVar[str] = "mass-change"
    family: ClassVar[Family] = "hydrodynamics"
    meaning: ClassVar[str] = "inertia changes within the run: a payload taken aboard or dropped, a hull taking water"
    parameters: ClassVar[tuple[Quantity, ...]] = (
        Quantity("ratio", "1", "inertia after over inertia before"),
        Quantity("time", "s", "when, after the start of the run"),
    )
    happens_at: ClassVar[tuple[str, ...]] = ("time",)
    grows_with: ClassVar[tuple[str, ...]] = ("ratio",)
    neutral: ClassVar[Mapping[str, float]] = {"ratio": 1.0}
    shown_by: ClassVar[str] = "residual against time: right up to a moment, then every acceleration off by one factor"
    mistaken_for: ClassVar[tuple[str, ...]] = ("gain-drift", "actuator-lag", "quadratic-drag")
    separated_by: ClassVar[str] = "the same pair of steps at the beginning, in the middle and at the end of the run"

    def places(self, scene: Scene) -> tuple[str, ...]:
        """All degrees of freedom at once: the same payload."""
        return ("+".join(scene.form.dofs),)

    def starts(self, place: str, scene: Scene) -> tuple[Mapping[str, float], ...]:
        """Heavier and lighter, at moments all over the run."""
        moments = np.linspace(0.0, scene.duration, MOMENTS + 2)[1:-1].tolist()
        return tuple({"ratio": ratio, "time": t} for ratio in RATIOS for t in moments)

    def bounds(self, place: str, scene: Scene) -> Mapping[str, tuple[float, float]]:
        """A fifth to five times the inertia, well within the longest run."""
        return {"ratio": (0.2, 5.0), "time": (0.02 * scene.duration, 0.98 * scene.duration)}

    def inputs(self, own: Applied) -> tuple[str, ...]:
        """What multiplies the inertia."""
        return (PAYLOAD,)

    def drive(self, own: Applied, drive: Drive) -> Drive:
        """Add the payload, with a stamp where it changes."""
        change = drive.start + own["time"]
        finer = drive.on(np.union1d(drive.t, [drive.start, change]))
        return finer.with_channel(PAYLOAD, np.where(finer.t >= change, own["ratio"], 1.0))

    def curve(self, own: Applied, scene: Scene) -> Curve:
        """Inertia over time."""
        t = np.array([0.0, own["time"], own["time"], max(scene.duration, own["time"])])
        ones = np.ones(4)
        inertia = np.array([1.0, 1.0, own["ratio"], own["ratio"]])
        return Curve(t, inertia, "time in the run [s]", "inertia, in shares of the first", "Mass change", plain=ones)
