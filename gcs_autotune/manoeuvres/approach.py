"""Before the relay: get way on where it is needed, and measure the noise of the watched signal."""

from __future__ import annotations

import math
from collections import deque

import numpy as np

from gcs_autotune.craft import Observation

__all__ = ["Approach"]

LEAST_TIME = 3.0
"""Chosen [s]: enough samples at 10 Hz to tell the noise within about 15 %."""
LONGEST_TIME = 30.0
"""Chosen [s]: a boat that is still gaining speed then is taken as it is."""
STEADY_WINDOW = 3.0
STEADY_SHARE = 0.03
"""Speed counts as steady when it changes less than this share (or 2 cm/s) over the window [s]."""


class Approach:
    """Watches until speed is steady (if way is needed) and the noise is known.

    ``noise_std`` comes from second differences, which a steady turn or drift does not disturb.
    """

    def __init__(self, signal: str, *, needs_way: bool) -> None:
        self.signal = signal
        self.done = False
        self.noise_std = 0.0
        self.speed = math.nan
        self._needs_way = needs_way
        self._start = math.nan
        self._x: list[float] = []
        self._speeds: deque[tuple[float, float]] = deque()

    def start(self, observation: Observation) -> None:
        """Take the time of the first observation."""
        self._start = observation.t

    def update(self, t: float, x: float, speed: float) -> None:
        """Take one sample: time [s], watched signal [rad or m], speed [m/s] (NaN when unknown)."""
        self._x.append(x)
        self._speeds.append((t, speed))
        while self._speeds[0][0] < t - STEADY_WINDOW:
            self._speeds.popleft()
        elapsed = t - self._start
        if elapsed < LEAST_TIME:
            return
        if not self._needs_way or self._is_steady() or elapsed >= LONGEST_TIME:
            self._finish()

    def _is_steady(self) -> bool:
        speeds = [s for _, s in self._speeds]
        if not all(math.isfinite(s) for s in speeds):
            return False
        half = len(speeds) // 2
        early, late = float(np.mean(speeds[:half])), float(np.mean(speeds[half:]))
        return late > 0.0 and abs(late - early) < max(STEADY_SHARE * late, 0.02)

    def _finish(self) -> None:
        tail = np.diff(np.asarray(self._x[-60:]), n=2)
        self.noise_std = float(np.sqrt(np.mean(tail**2) / 6.0)) if len(tail) else 0.0
        finite = [s for _, s in self._speeds if math.isfinite(s)]
        self.speed = float(np.mean(finite)) if finite else math.nan
        self.done = True
