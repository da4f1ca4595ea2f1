"""How regularly something is really sent."""

from __future__ import annotations

import math

from gcs_autotune.clock import Clock

__all__ = ["Beat"]


class Beat:
    """Counts what is sent while it should be, on the link's clock.

    Attributes
    ----------
    longest : longest pause between two [s]; NaN before the second.
    """

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._last = math.nan
        self._count = 0
        self._time = 0.0
        self.longest = math.nan

    @property
    def rate(self) -> float:
        """Mean rate [Hz]; NaN before the second."""
        return self._count / self._time if self._time > 0.0 else math.nan

    def strike(self) -> None:
        """One is sent now."""
        now = self._clock.now()
        if not math.isnan(self._last):
            pause = now - self._last
            self._count += 1
            self._time += pause
            self.longest = max(pause, self.longest) if not math.isnan(self.longest) else pause
        self._last = now

    def rest(self) -> None:
        """For a while nothing is to be sent."""
        self._last = math.nan
