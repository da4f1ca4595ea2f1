"""Measurement delay: signals are reported late."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from gcs_autotune.effects.earlier import earlier
from gcs_autotune.effects.effect import Applied, Effect, Family, Observed, Quantity, Scene, columns_of
from gcs_autotune.sname import DOFS

__all__ = ["MeasurementDelay"]

_POSITIONS = frozenset(d.position for d in DOFS.values())


class MeasurementDelay(Effect):
    """One signal, or all (``"psi+r"``), shows what was ``delay`` ago: a filter in the sensor, a slow bus."""

    slug: ClassVar[str] = "measurement-delay"
    family: ClassVar[Family] = "sensor"
    meaning: ClassVar[str] = "a signal is reported late: filtering in the sensor, a slow bus"
    parameters: ClassVar[tuple[Quantity, ...]] = (Quantity("delay", "s", "age of what is reported"),)
    yields_to: ClassVar[tuple[str, ...]] = ("input-delay", "time-offset")
    grows_with: ClassVar[tuple[str, ...]] = ("delay",)
    shown_by: ClassVar[str] = "residual in proportion to the signal's own rate of change; one signal later than its kin"
    mistaken_for: ClassVar[tuple[str, ...]] = ("time-offset", "input-delay", "actuator-lag")
    separated_by: ClassVar[str] = (
        "a zig-zag with gyro and compass both recorded: a late sensor lags its kin, a late push does not"
    )

    def places(self, scene: Scene) -> tuple[str, ...]:
        """Each signal, and all together."""
        names = tuple(scene.signals)
        return (*names, "+".join(names)) if len(names) > 1 else names

    def starts(self, place: str, scene: Scene) -> tuple[Mapping[str, float], ...]:
        """A sample and a half, and shares of the craft's time constant."""
        low, high = self.bounds(place, scene)["delay"]
        sizes = {min(max(s, low), 0.8 * high) for s in (1.5 * scene.interval, 0.2 * scene.pace, 0.7 * scene.pace)}
        return tuple({"delay": s} for s in sorted(sizes))

    def bounds(self, place: str, scene: Scene) -> Mapping[str, tuple[float, float]]:
        """Two time constants, a dozen samples at least; never more than a quarter of a run."""
        return {"delay": (0.0, min(max(2.0 * scene.pace, 12.0 * scene.interval), 0.25 * scene.duration))}

    def observe(self, own: Applied, seen: Observed) -> Observed:
        """Show what was."""
        if own["delay"] == 0.0:
            return seen
        t = np.ascontiguousarray(seen.t, dtype=np.float64)
        for name in columns_of(own.place):
            if name in seen.signals:
                y = np.ascontiguousarray(seen.signals[name], dtype=np.float64)
                seen = seen.with_signal(name, earlier(t, y, own["delay"], coasting=name in _POSITIONS))
        return seen
