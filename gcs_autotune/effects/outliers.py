"""Outliers: single samples that are far off."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import ClassVar

import numpy as np

from gcs_autotune.effects.contamination import Contamination, contamination, stray, without_motion
from gcs_autotune.effects.effect import SIGNAL, Applied, Array, Curve, Effect, Family, Leftover, Quantity, Scene

__all__ = ["Outliers"]


class Outliers(Effect):
    """A ``share`` of the samples is off by about ``size`` (rms): lost bits, reflections, a fix that jumps.

    They strike anywhere: deviations that come in flocks or with the motion's changes are a wrong model, not outliers.
    """

    slug: ClassVar[str] = "outliers"
    family: ClassVar[Family] = "sensor"
    meaning: ClassVar[str] = "single samples are far off: lost bits, reflections, a fix that jumps"
    parameters: ClassVar[tuple[Quantity, ...]] = (
        Quantity("share", "1", "of the samples that are off"),
        Quantity("size", SIGNAL, "rms of what they are off by"),
    )
    shown_by: ClassVar[str] = "lone spikes in the residual, both ways, at no particular command or motion"
    mistaken_for: ClassVar[tuple[str, ...]] = ("quantisation", "measurement-delay", "backlash")
    separated_by: ClassVar[str] = "a minute at rest with the recorder running: the spikes stay"
    fixed: ClassVar[tuple[str, ...]] = ("share", "size")

    def places(self, scene: Scene) -> tuple[str, ...]:
        """Every signal."""
        return tuple(scene.signals)

    def starts(self, place: str, scene: Scene) -> tuple[Mapping[str, float], ...]:
        """None yet; :meth:`learn` counts and sizes them."""
        return ({"share": 0.0, "size": 0.1 * scene.spread[place]},)

    def bounds(self, place: str, scene: Scene) -> Mapping[str, tuple[float, float]]:
        """More than a third are no exceptions."""
        return {"share": (0.0, 0.3), "size": (0.0, 1e3 * scene.spread[place])}

    def learn(self, own: Applied, left: Sequence[Leftover]) -> Applied:
        """Count and size what stands out of its neighbours; none when it keeps to the motion or to flocks."""
        mine = [x for x in left if x.signal == own.place]
        found = contamination(np.concatenate([stray(x.error) for x in mine])) if mine else None
        if found is None or not without_motion(
            [found.flags(stray(x.error)) for x in mine], [x.measured - x.error for x in mine]
        ):
            return own.with_values({"share": 0.0})
        own = own.with_values({"share": found.share, "size": found.size})
        return replace(own, constants={**own.constants, "level": found.level})

    def judge(self, own: Applied, left: Leftover, columns: Array) -> tuple[Array, Array, float]:
        """Weigh outliers by the size they may have, at the price of that size and of picking them."""
        if left.signal != own.place or own["share"] <= 0.0:
            return left.error, columns, 0.0
        law = Contamination(own["share"], own["size"], own.constants["level"])
        off = law.flags(stray(left.error))
        broader = 1.0 + (law.size / law.level) ** 2
        weight = np.where(off, 1.0 / math.sqrt(broader), 1.0)
        count = float(np.sum(off))
        odds = count * math.log(law.share) + (len(off) - count) * math.log1p(-law.share)
        return weight * left.error, weight[:, None] * columns, count * math.log(broader) - 2.0 * odds

    def uncertainty(self, own: Applied, left: Sequence[Leftover]) -> Mapping[str, float]:
        """Of a count, and of the rms of so many."""
        n = sum(len(x.error) for x in left if x.signal == own.place)
        count = max(own["share"] * n, 1.0)
        return {"share": math.sqrt(own["share"] / max(n, 1)), "size": own["size"] / math.sqrt(2.0 * count)}

    def curve(self, own: Applied, scene: Scene) -> Curve | None:
        """The law of the errors: a narrow bell on broad feet."""
        level = own.constants.get("level", 0.0)
        if level <= 0.0:
            return None
        law = Contamination(own["share"], own["size"], level)
        x = np.linspace(-3.0, 3.0, 1201) * max(law.size, 2.0 * level)
        core = np.exp(-0.5 * (x / level) ** 2) / (level * math.sqrt(2.0 * math.pi))
        unit = scene.signals[own.place]
        label = f"density [1/({unit})]"
        return Curve(x, law.density(x), f"error of {own.place} [{unit}]", label, "Law of the errors", plain=core)
