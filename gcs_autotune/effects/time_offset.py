"""Time offset: commands and motion were stamped by two clocks."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

from gcs_autotune.effects.effect import Applied, Array, Effect, Family, Quantity, Scene

__all__ = ["TimeOffset"]


class TimeOffset(Effect):
    """The signals' stamps are late by ``offset`` against the inputs'; negative: motion begins before its command."""

    slug: ClassVar[str] = "time-offset"
    family: ClassVar[Family] = "bookkeeping"
    meaning: ClassVar[str] = "commands and motion were stamped by two clocks that disagree"
    parameters: ClassVar[tuple[Quantity, ...]] = (Quantity("offset", "s", "lateness of the signals' stamps"),)
    yields_to: ClassVar[tuple[str, ...]] = ("input-delay",)
    grows_with: ClassVar[tuple[str, ...]] = ("offset",)
    shown_by: ClassVar[str] = "the same residual after every change of command, in every signal; correlated at one lag"
    mistaken_for: ClassVar[tuple[str, ...]] = ("input-delay", "measurement-delay", "actuator-lag")
    separated_by: ClassVar[str] = "the same manoeuvre in two recordings: a delay stays, the offset of clocks changes"

    def places(self, scene: Scene) -> tuple[str, ...]:
        """The clocks of the file, when something is commanded."""
        return ("t",) if scene.inputs else ()

    def starts(self, place: str, scene: Scene) -> tuple[Mapping[str, float], ...]:
        """A few samples, and shares of the craft's time constant, both ways."""
        low, high = self.bounds(place, scene)["offset"]
        sizes = (2.0 * scene.interval, max(0.3 * scene.pace, 4.0 * scene.interval))
        return tuple({"offset": min(max(sign * s, 0.8 * low), 0.8 * high)} for s in sizes for sign in (-1.0, 1.0))

    def bounds(self, place: str, scene: Scene) -> Mapping[str, tuple[float, float]]:
        """Two time constants, a dozen samples at least; never more than a quarter of a run."""
        most = min(max(2.0 * scene.pace, 12.0 * scene.interval), 0.25 * scene.duration)
        return {"offset": (-most, most)}

    def retime(self, own: Applied, t: Array, start: float, *, inputs: bool) -> Array:
        """Bring the inputs' stamps to the signals' clock."""
        return t + own["offset"] if inputs else t
