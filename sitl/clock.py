"""Simulated time relative to the wall clock, for a free-running vehicle. Only this module sleeps."""

from __future__ import annotations

import time
from collections.abc import Callable

__all__ = ["Pacer"]

_MOST_BEHIND = 0.5
"""Longest delay that is caught up [wall s]. After a longer one the simulation stays late. Project choice."""


class Pacer:
    """Computes the simulated time at *speedup*, and waits for it.

    ``wall`` and ``sleep`` can be replaced in tests; ``speedup``: simulated seconds per second.
    """

    def __init__(
        self,
        speedup: float,
        *,
        wall: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        self.speedup = speedup
        self._wall = wall
        self._sleep = sleep
        self._origin = wall()

    def now(self) -> float:
        """Return the simulated time [s] that corresponds to the present wall-clock time."""
        return (self._wall() - self._origin) * self.speedup

    def wait_until(self, t: float) -> None:
        """Sleep until simulated time *t* [s]. If *t* is long past, set the clock back to *t*."""
        ahead = (t - self.now()) / self.speedup
        if ahead > 0.0:
            self._sleep(ahead)
        elif ahead < -_MOST_BEHIND:
            self._origin -= ahead
