"""How a running manoeuvre tells people how it goes, without knowing who they are.

The sequencer and the workflow hand a :class:`Progress` to a :class:`Watcher` at every control tick; what
becomes of it (a live line, a log, nothing) is the report room's business.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

__all__ = ["Progress", "SilentWatcher", "Watcher"]


@dataclass(frozen=True, slots=True)
class Progress:
    """A moment of a manoeuvre, in SI units and radians; unknown numbers are NaN.

    ``signal`` names the controlled one (``psi``, ``z``, ``x``), ``target`` its reference; ``output`` is the
    actuator demand [fraction of full]; ``periods`` and ``periods_needed`` count oscillations that satisfy
    the stop rule, ``scatter`` their relative spread; ``guard`` and ``guard_share`` name the safety limit
    nearest to tripping and how much of it is used (0..1). ``step`` of ``steps`` is the stage under way (0: not known),
    ``elapsed`` and ``left`` are seconds since the start and to the end, as far as that can be told.
    """

    stage: str
    manoeuvre: str
    t: float
    signal: str = ""
    value: float = math.nan
    target: float = math.nan
    output: float = math.nan
    amplitude: float = math.nan
    periods: int = 0
    periods_needed: int = 0
    scatter: float = math.nan
    guard: str = ""
    guard_share: float = 0.0
    age: float = 0.0
    step: int = 0
    steps: int = 0
    elapsed: float = math.nan
    left: float = math.nan


class Watcher(Protocol):
    """Somebody who wants to know."""

    def update(self, progress: Progress) -> None:
        """Take note of one control tick."""
        ...

    def say(self, text: str) -> None:
        """Take note of something that happened, in one sentence."""
        ...


class SilentWatcher:
    """Nobody is watching."""

    def update(self, progress: Progress) -> None:
        """Ignore it."""

    def say(self, text: str) -> None:
        """Ignore it."""
