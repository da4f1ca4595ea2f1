"""How regularly something is really sent."""

from __future__ import annotations

import math
from collections import deque

from gcs_autotune.clock import Clock

__all__ = ["Beat"]

_WORTH_KEEPING = 0.02
"""Seconds: shorter ones never matter."""
_KEPT = 200
_TELLING = 1.0
"""Seconds of sending after which the pace of the vehicle's time can be told."""


class Beat:
    """Counts what is sent while it should be, on the link's clock.

    Attributes
    ----------
    longest : longest pause between two [s]; NaN before the second.
    pace : seconds of the vehicle's time per second of the link's, 1 until it can be told; more in a simulation that
        runs ahead.
    """

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._last = math.nan
        self._count = 0
        self._time = 0.0
        self._pauses: deque[tuple[float, float]] = deque(maxlen=_KEPT)
        self._begun = (math.nan, math.nan)
        self.longest = math.nan
        self.pace = 1.0

    @property
    def rate(self) -> float:
        """Mean rate [Hz]; NaN before the second."""
        return self._count / self._time if self._time > 0.0 else math.nan

    def pause_since(self, t: float) -> float:
        """Return the longest pause [s] that ended after link time *t* [s]; 0 without any."""
        return max((pause for end, pause in self._pauses if end >= t), default=0.0)

    def strike(self, vehicle_time: float = math.nan) -> None:
        """One is sent now; the vehicle's last stamp says *vehicle_time* [s]."""
        now = self._clock.now()
        self._keep_pace(now, vehicle_time)
        if not math.isnan(self._last):
            pause = now - self._last
            self._count += 1
            self._time += pause
            self.longest = max(pause, self.longest) if not math.isnan(self.longest) else pause
            if pause > _WORTH_KEEPING:
                self._pauses.append((now, pause))
        self._last = now

    def _keep_pace(self, now: float, vehicle_time: float) -> None:
        begun, then = self._begun
        if not vehicle_time >= then:  # the first, or its clock ran back
            self._begun = (now, vehicle_time)
        elif now - begun > _TELLING:
            self.pace = (vehicle_time - then) / (now - begun)

    def rest(self) -> None:
        """For a while nothing is to be sent."""
        self._last = math.nan
