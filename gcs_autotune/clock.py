"""Time as the tuner sees it. Logic never reads the wall clock itself: it is handed a :class:`Clock`.

Computations may be given a :func:`time_limit`: deep inside, between one simulation and the next, :func:`check_time`
then ends them by :class:`OutOfTime`. Whoever set the limit keeps what there is.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from typing import Protocol

__all__ = ["Clock", "Deadline", "ManualClock", "OutOfTime", "WallClock", "check_time", "time_limit"]


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


class OutOfTime(Exception):
    """The time given to a computation is over; the message says at what. It never leaves whoever gave it."""


_limit: ContextVar[Deadline | None] = ContextVar("time_limit", default=None)
"""Of this thread, and of what it forks: a fit deep inside need not be handed it by everyone above."""

_under_way: ContextVar[str] = ContextVar("under_way", default="a fit")


@contextmanager
def time_limit(deadline: Deadline | None) -> Iterator[None]:
    """Let what is computed inside end at *deadline*, None for never; it takes the place of any limit outside."""
    token, words = _limit.set(deadline), _under_way.set(_under_way.get())
    try:
        yield
    finally:
        _limit.reset(token)
        _under_way.reset(words)


def check_time(at: str = "") -> None:
    """Do nothing, or end what is being computed: *at* says in words what that is, empty: what was said last.

    Raises
    ------
    OutOfTime
        The time given is over.
    """
    if at:
        _under_way.set(at)
    deadline = _limit.get()
    if deadline is not None and deadline.expired:
        raise OutOfTime(_under_way.get())
