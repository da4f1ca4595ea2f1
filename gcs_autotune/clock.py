"""Clocks and budgets. Logic never reads the wall clock; it receives a :class:`Clock`.

A computation may have a :class:`Budget` of work and a deadline. Every pass of a simulation or a filter calls
:func:`spend`, which raises :class:`OutOfTime` once either is used up. Work is counted in samples, so the computation
ends at the same pass on every machine and with any number of processes. The deadline is a safety stop.
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
    """A source of monotonic seconds."""

    def now(self) -> float:
        """Return monotonic time [s]; the zero point is arbitrary."""
        ...


class WallClock:
    """The computer's monotonic clock, for links to real vehicles."""

    def now(self) -> float:
        """Return ``time.monotonic()`` [s]."""
        return time.monotonic()


class ManualClock:
    """A clock that moves only on request, for the lock-stepped simulator and the tests."""

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
    """A deadline on a clock."""

    clock: Clock
    at: float

    @classmethod
    def after(cls, clock: Clock, seconds: float) -> Deadline:
        """Return the deadline *seconds* from now on *clock*."""
        return cls(clock, clock.now() + seconds)

    @property
    def remaining(self) -> float:
        """Seconds left; never negative."""
        return max(0.0, self.at - self.clock.now())

    @property
    def expired(self) -> bool:
        """Whether the deadline has passed."""
        return self.clock.now() >= self.at


class OutOfTime(Exception):
    """Raised when the deadline of a :class:`Budget` has passed. The message states the interrupted step."""


class OutOfWork(OutOfTime):
    """Raised when the work of a :class:`Budget` is used up."""


@dataclass(slots=True, eq=False)
class Budget:
    """The resources of a computation, and their use.

    work : limit of samples processed by simulations and filters. deadline : latest end; None: none.
    done : samples processed so far. stopped : the step that was interrupted, empty while running.
    by_work : whether it was stopped by *work* and not by the deadline.
    """

    work: float = math.inf
    deadline: Deadline | None = None
    done: float = field(default=0.0, init=False)
    stopped: str = field(default="", init=False)
    by_work: bool = field(default=False, init=False)

    def check(self) -> None:
        """Check that work and time are left.

        Raises
        ------
        OutOfWork
            The work is used up. OutOfTime: the deadline has passed.
        """
        if self.done > self.work or (self.deadline is not None and self.deadline.expired):
            self.stop()

    def stop(self) -> NoReturn:
        """Stop the computation with the matching error.

        Raises
        ------
        OutOfWork
            The work is used up. OutOfTime: the deadline has passed.
        """
        out_of_work = self.done > self.work
        if not self.stopped:
            self.stopped, self.by_work = _under_way.get(), out_of_work
        raise (OutOfWork if out_of_work else OutOfTime)(_under_way.get())


_effort: ContextVar[Budget | None] = ContextVar("effort", default=None)
"""Budget of this thread and its forks, so that it need not be passed through every call."""

_under_way: ContextVar[str] = ContextVar("under_way", default="a fit")


@contextmanager
def limited_to(effort: Budget | None) -> Iterator[None]:
    """Limit the computations inside this context to *effort*; None: no limit. It replaces an outer limit."""
    token, words = _effort.set(effort), _under_way.set(_under_way.get())
    try:
        yield
    finally:
        _effort.reset(token)
        _under_way.reset(words)


def current_effort() -> Budget | None:
    """Return the budget of this computation; None without a limit."""
    return _effort.get()


@contextmanager
def uncounted() -> Iterator[None]:
    """Do not count the work inside this context; the deadline still applies."""
    effort = _effort.get()
    done = 0.0 if effort is None else effort.done
    try:
        yield
    finally:
        if effort is not None:
            effort.done = done


def spend(samples: float) -> None:
    """Count the work of *samples* samples before it is done.

    Raises
    ------
    OutOfTime
        Work or time is used up.
    """
    effort = _effort.get()
    if effort is not None:
        effort.done += samples
        effort.check()


def check_effort(at: str = "") -> None:
    """Check the budget. *at* : the current step, for the message; empty: unchanged.

    Raises
    ------
    OutOfTime
        Work or time is used up.
    """
    if at:
        _under_way.set(at)
    effort = _effort.get()
    if effort is not None:
        effort.check()
