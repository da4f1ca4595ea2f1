"""Time scale: the file's clock runs fast or slow."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

from gcs_autotune.effects.effect import Applied, Array, Effect, Family, Quantity, Scene
from gcs_autotune.effects.visibility import rates_checked

__all__ = ["TimeScale"]


class TimeScale(Effect):
    """File time is ``factor`` times true time: a wrong sample rate, a simulation faster than the world."""

    slug: ClassVar[str] = "time-scale"
    family: ClassVar[Family] = "bookkeeping"
    meaning: ClassVar[str] = "the clock of the file runs fast or slow: a wrong sample rate, or not real time"
    parameters: ClassVar[tuple[Quantity, ...]] = (Quantity("factor", "1", "seconds in the file per true second"),)
    grows_with: ClassVar[tuple[str, ...]] = ("factor",)
    neutral: ClassVar[Mapping[str, float]] = {"factor": 1.0}
    shown_by: ClassVar[str] = "every position changes by the same factor more (or less) than its velocity says"
    mistaken_for: ClassVar[tuple[str, ...]] = ("unit-error", "time-offset", "mass-change")
    separated_by: ClassVar[str] = (
        "a stopwatch beside the recorder: one minute of recording must hold one minute of stamps"
    )

    def places(self, scene: Scene) -> tuple[str, ...]:
        """The whole file, when a position is measured beside its velocity; else inertia and drag absorb it."""
        return ("t",) if rates_checked(scene) else ()

    def starts(self, place: str, scene: Scene) -> tuple[Mapping[str, float], ...]:
        """Slightly and grossly, both ways."""
        return tuple({"factor": f} for f in (0.5, 0.85, 1.18, 2.0))

    def bounds(self, place: str, scene: Scene) -> Mapping[str, tuple[float, float]]:
        """A factor beyond ten is a time column in another unit, which reading the file finds."""
        return {"factor": (0.1, 10.0)}

    def retime(self, own: Applied, t: Array, start: float, *, inputs: bool) -> Array:
        """Run the true clock from the first stamp on."""
        return start + (t - start) / own["factor"]
