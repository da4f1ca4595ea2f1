"""Time as the tuner sees it. Logic never reads the wall clock itself: it is handed a :class:`Clock`."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Protocol

__all__ = ["Clock", "Deadline", "ManualClock", "WallClock"]


class Clock(Protocol):
    """Anything that tells monotonic seconds."""

    def now(self) -> float:
        """Return monotonic time [s]; the zero point is arbitrary."""
        ...


class WallClock:
    """The machine's monotonic clock, for links to real vehicles."""

    def now(self) -> float:
        """Return ``time.monotonic()`` [s]."""
        return time.monotonic()


class ManualClock:
    """A clock that moves only when told to: the lock-stepped simulator and the tests own one."""

    def __init__(self, start: float = 0.0) -> None:
        self._now = start

    def now(self) -> float:
        """Return the time last set [s]."""
        return self._now

    def advance_to(self, t: float) -> None:
        """Move forward to *t* [s]; moving backwards is ignored."""
        self._now = max(self._now, t)

    def advance(self, dt: float) -> None:
        """Move forward by *dt* [s]."""
        self.advance_to(self._now + dt)


@dataclass(frozen=True, slots=True)
class Deadline:
    """A moment on a clock by which something must have happened."""

    clock: Clock
    at: float

    @classmethod
    def after(cls, clock: Clock, seconds: float) -> Deadline:
        """Return the deadline *seconds* from now on *clock*."""
        return cls(clock, clock.now() + seconds)

    @property
    def remaining(self) -> float:
        """Seconds left, never negative."""
        return max(0.0, self.at - self.clock.now())

    @property
    def expired(self) -> bool:
        """Whether the moment has passed."""
        return self.clock.now() >= self.at
