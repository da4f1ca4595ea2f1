"""Gyro bias: a rate of turn where there is none."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

from gcs_autotune.effects.effect import SIGNAL, Applied, Effect, Family, Observed, Quantity, Scene

__all__ = ["GyroBias"]


class GyroBias(Effect):
    """The gyro reads ``bias`` too much, all the time."""

    slug: ClassVar[str] = "gyro-bias"
    family: ClassVar[Family] = "sensor"
    meaning: ClassVar[str] = "the gyro reads a constant rate too much"
    parameters: ClassVar[tuple[Quantity, ...]] = (Quantity("bias", SIGNAL, "what a resting gyro reads"),)
    grows_with: ClassVar[tuple[str, ...]] = ("bias",)
    shown_by: ClassVar[str] = "mean of the rate's residual, while the heading's slope fits"
    mistaken_for: ClassVar[tuple[str, ...]] = ("input-bias", "asymmetric-thrust", "compass-deviation")
    separated_by: ClassVar[str] = "a minute moored or aground with the recorder running: only the gyro still turns"

    def places(self, scene: Scene) -> tuple[str, ...]:
        """The rates of turn that are measured."""
        return tuple(s for s in ("r", "p", "q") if s in scene.signals)

    def starts(self, place: str, scene: Scene) -> tuple[Mapping[str, float], ...]:
        """A tenth of the rate's spread, to be scaled: the effect is linear."""
        return ({"bias": 0.1 * scene.spread[place]},)

    def bounds(self, place: str, scene: Scene) -> Mapping[str, tuple[float, float]]:
        """No more than the largest rate ever read."""
        most = max((abs(v) for v in scene.extent.get(place, ())), default=3.0 * scene.spread[place])
        return {"bias": (-most, most)}

    def observe(self, own: Applied, seen: Observed) -> Observed:
        """Add the bias."""
        return seen.with_signal(own.place, seen.signals[own.place] + own["bias"])
