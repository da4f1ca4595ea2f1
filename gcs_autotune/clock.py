"""Time as the tuner sees it. Logic never reads the wall clock itself: it is handed a :class:`Clock`.

A computation may be given an :class:`Budget`: an amount of work and a deadline. Every pass of a simulation or a filter
calls :func:`spend`, which ends the computation by :class:`OutOfTime` when either is used up. Work is counted in
samples, so it ends at the same pass on every machine and with any number of processes. Time is a stop valve.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field
from typing import NoReturn, Protocol

__all__ = [
    "Budget",
    "Clock",
    "Deadline",
    "ManualClock",
    "OutOfTime",
    "OutOfWork",
    "WallClock",
    "check_effort",
    "current_effort",
    "limited_to",
    "spend",
    "uncounted",
]


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
    """The deadline of an :class:`Budget` has passed. The message says what was under way."""


class OutOfWork(OutOfTime):
    """The work of an :class:`Budget` is used up."""


@dataclass(slots=True, eq=False)
class Budget:
    """What a computation may use, and what it has used.

    work : samples that simulations and filters may pass over. deadline : when to stop at the latest; None: never.
    done : samples passed over so far. stopped : what was under way when it was stopped, empty while it may go on.
    by_work : it was stopped by *work*, not by the deadline.
    """

    work: float = math.inf
    deadline: Deadline | None = None
    done: float = field(default=0.0, init=False)
    stopped: str = field(default="", init=False)
    by_work: bool = field(default=False, init=False)

    def check(self) -> None:
        """Do nothing while there is work and time left.

        Raises
        ------
        OutOfWork
            The work is used up. OutOfTime: the deadline has passed.
        """
        if self.done > self.work or (self.deadline is not None and self.deadline.expired):
            self.stop()

    def stop(self) -> NoReturn:
        """Stop what is under way.

        Raises
        ------
        OutOfWork
            The work is used up. OutOfTime: else.
        """
        out_of_work = self.done > self.work
        if not self.stopped:
            self.stopped, self.by_work = _under_way.get(), out_of_work
        raise (OutOfWork if out_of_work else OutOfTime)(_under_way.get())


_effort: ContextVar[Budget | None] = ContextVar("effort", default=None)
"""Of this thread, and of what it forks: a fit deep inside need not be handed it by everyone above."""

_under_way: ContextVar[str] = ContextVar("under_way", default="a fit")


@contextmanager
def limited_to(effort: Budget | None) -> Iterator[None]:
    """Limit what is computed inside to *effort*, None for no limit; it takes the place of any limit outside."""
    token, words = _effort.set(effort), _under_way.set(_under_way.get())
    try:
        yield
    finally:
        _effort.reset(token)
        _under_way.reset(words)


def current_effort() -> Budget | None:
    """Return what this computation is limited to; None for no limit."""
    return _effort.get()


@contextmanager
def uncounted() -> Iterator[None]:
    """Let work inside not count; the deadline holds."""
    effort = _effort.get()
    done = 0.0 if effort is None else effort.done
    try:
        yield
    finally:
        if effort is not None:
            effort.done = done


def spend(samples: float) -> None:
    """Count work of so many *samples*, about to be done.

    Raises
    ------
    OutOfTime
        The work or the time given is used up.
    """
    effort = _effort.get()
    if effort is not None:
        effort.done += samples
        effort.check()


def check_effort(at: str = "") -> None:
    """Do nothing, or stop what is being computed: *at* says in words what that is, empty: what was said last.

    Raises
    ------
    OutOfTime
        The work or the time given is used up.
    """
    if at:
        _under_way.set(at)
    effort = _effort.get()
    if effort is not None:
        effort.check()
