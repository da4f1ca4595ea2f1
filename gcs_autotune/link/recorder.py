"""Collects signals into a Trial: every sample with the vehicle's own stamp, nothing resampled."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from gcs_autotune.sname import SIGNALS
from gcs_autotune.trial import Channel, Mark, Trial

__all__ = ["UNITS", "Recorder"]

UNITS: Mapping[str, str] = {
    **{name: unit for name, (unit, _) in SIGNALS.items()},
    **dict.fromkeys("XYZKMN", "1"),
    "battery": "V",
    "battery_remaining": "1",
    "pressure": "Pa",
}
"""Channel -> unit. Forces are fractions of full actuator output here."""


class Recorder:
    """Takes samples while a trial runs, and drops them otherwise."""

    def __init__(self) -> None:
        self._name: str | None = None
        self._samples: dict[str, tuple[list[float], list[float]]] = {}
        self._marks: list[Mark] = []
        self.late = 0

    def start(self, name: str) -> None:
        """Begin a new trial; what an unfinished one held is dropped."""
        self._name = name
        self._samples, self._marks, self.late = {}, [], 0

    def take(self, t: float, values: Mapping[str, float]) -> None:
        """Add samples stamped *t* [s]; one older than the last of its channel is counted as late and left out."""
        if self._name is None:
            return
        for name, value in values.items():
            times, column = self._samples.setdefault(name, ([], []))
            if times and t < times[-1]:
                self.late += 1
                continue
            times.append(t)
            column.append(value)

    def mark(self, mark: Mark) -> None:
        """Add an event."""
        if self._name is not None:
            self._marks.append(mark)

    def stop(self, ending: str, reason: str, meta: Mapping[str, Any]) -> Trial:
        """End the trial and return it; an empty one when none was running."""
        channels = {
            name: Channel(name, UNITS.get(name, "1"), np.array(times), np.array(column))
            for name, (times, column) in self._samples.items()
        }
        name, self._name = self._name or "", None
        details = {**meta, "late_samples": self.late} if self.late else dict(meta)
        return Trial(name, channels, tuple(self._marks), ending, reason, details)
