"""What a session does by the clock while it pumps: heartbeats, overrides, time synchronisation."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from gcs_autotune.clock import Clock

__all__ = ["Duties", "Duty"]

_ROUNDING = 1e-6
"""Seconds: what sums of decimal fractions may be off."""


@dataclass(slots=True, eq=False)
class Duty:
    """Something done every ``period`` [s of link time] while pumping."""

    clock: Clock
    period: float
    action: Callable[[], None]
    due: float

    def postpone(self) -> None:
        """It has just been done: next time a whole period from now."""
        self.due = self.clock.now() + self.period


class Duties:
    """All of them, in the order they were taken on."""

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._duties: list[Duty] = []

    def add(self, period: float, action: Callable[[], None]) -> Duty:
        """Take on *action* every *period* [s], first at once."""
        duty = Duty(self._clock, period, action, self._clock.now())
        self._duties.append(duty)
        return duty

    def next_due(self) -> float:
        """Return the link time [s] at which the next one is due; there must be one."""
        return min(duty.due for duty in self._duties)

    def do(self, now: float) -> None:
        """Do everything that is due at link time *now* [s]."""
        for duty in self._duties:
            if duty.due <= now + _ROUNDING:
                duty.postpone()
                duty.action()
