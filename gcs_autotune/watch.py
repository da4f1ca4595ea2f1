"""How a running manoeuvre tells people how it goes, without knowing who they are.

The sequencer and the workflow hand a :class:`Progress` to a :class:`Watcher` at every control tick, and a :data:`Fact`
when there is one; what becomes of it (a live line, a log, a page, nothing) is the business of who watches. A watcher
returns at once: the loop that holds the sticks is the one that tells.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

__all__ = [
    "Fact",
    "Intentions",
    "LeftAs",
    "NewValue",
    "PredictedCost",
    "PredictedTrack",
    "Progress",
    "ProposedGains",
    "Room",
    "SilentWatcher",
    "Vitals",
    "Watcher",
    "Words",
]


@dataclass(frozen=True, slots=True)
class Progress:
    """A moment of a manoeuvre, in SI units and radians; unknown numbers are NaN.

    ``signal`` names the controlled one (``psi``, ``z``, ``x``), ``target`` its reference; ``output`` is the
    actuator demand [fraction of full]; ``periods`` and ``periods_needed`` count oscillations that satisfy
    the stop rule, ``scatter`` their relative spread; ``guard`` and ``guard_share`` name the safety limit
    nearest to tripping and how much of it is used (0..1). ``step`` of ``steps`` is the stage under way (0: not known),
    ``elapsed`` and ``left`` are seconds since the start and to the end, as far as that can be told. ``rate`` is the
    derivative of the controlled signal by time, ``x``, ``y`` [m] north and east and ``psi`` [rad] where the craft is.
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
    rate: float = math.nan
    x: float = math.nan
    y: float = math.nan
    psi: float = math.nan


@dataclass(frozen=True, slots=True)
class Room:
    """Where the manoeuvre under way may go.

    ``x``, ``y`` [m north, east] is what ``distance`` [m] counts from; ``zones`` are (corners [m north, east], radius
    [m], whether it is stayed inside), circles having one corner; ``bounds`` signal -> (least, greatest), in SI and
    radians. Unknown numbers are NaN, absent limits infinite.
    """

    x: float
    y: float
    distance: float
    zones: tuple[tuple[tuple[tuple[float, float], ...], float, bool], ...] = ()
    bounds: Mapping[str, tuple[float, float]] | None = None


@dataclass(frozen=True, slots=True)
class Vitals:
    """The vehicle, about once a second: battery [V], [0..1], round trip [s] and rate of ATTITUDE [Hz]; NaN: unknown."""

    mode: str
    armed: bool
    battery_voltage: float = math.nan
    battery_remaining: float = math.nan
    round_trip: float = math.nan
    attitude_rate: float = math.nan


@dataclass(frozen=True, slots=True)
class Words:
    """A STATUSTEXT of the vehicle, raw; ``severity`` 0 (emergency) to 7 (debug)."""

    severity: int
    text: str


@dataclass(frozen=True, slots=True)
class Intentions:
    """What is going to be done, a sentence without its "will" each, told before anybody is asked and anything moves."""

    texts: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class NewValue:
    """One parameter to be written, as the vehicle calls it: old value, new one, why."""

    parameter: str
    old: float
    new: float
    reason: str


@dataclass(frozen=True, slots=True)
class ProposedGains:
    """What is about to be written, told before anybody is asked.

    ``cost_before``, ``cost_after`` are the ITAE of the step per unit step [s^2] that the model promises; NaN where no
    model does. ``cost_worst`` is the latter at the worst of the 95 % region of the model.
    """

    values: tuple[NewValue, ...]
    cost_before: float = math.nan
    cost_after: float = math.nan
    cost_worst: float = math.nan


@dataclass(frozen=True, slots=True)
class PredictedCost:
    """What the gains that would be designed by now promise: ITAE of the step per unit step [s^2].

    ``nominal`` by the model fitted so far, ``worst`` over the 95 % region of its parameters.
    """

    nominal: float
    worst: float


@dataclass(frozen=True, slots=True)
class PredictedTrack:
    """The preview of a run, told before it is flown.

    ``x``, ``y`` [m north, east] and ``psi`` [rad] are where the craft was then; ``ahead``, ``abeam`` [m] the track as
    seen from there, bow ahead. ``told`` is time, room and turning in words, ``trouble`` why it had better not be flown.
    """

    run: str
    x: float
    y: float
    psi: float
    ahead: tuple[float, ...]
    abeam: tuple[float, ...]
    told: str
    trouble: str = ""


@dataclass(frozen=True, slots=True)
class LeftAs:
    """How the craft was left: mode and armed state by its heartbeat, and what ``differs`` from how it was found."""

    mode: str
    armed: bool
    differs: Mapping[str, str]


Fact = Intentions | Room | Vitals | Words | ProposedGains | PredictedCost | PredictedTrack | LeftAs
"""What is told besides ticks and sentences."""


class Watcher(Protocol):
    """Somebody who wants to know."""

    def update(self, progress: Progress) -> None:
        """Take note of one control tick."""
        ...

    def say(self, text: str) -> None:
        """Take note of something that happened, in one sentence."""
        ...

    def note(self, fact: Fact) -> None:
        """Take note of a fact; who shows none may ignore it."""
        ...


class SilentWatcher:
    """Nobody is watching."""

    def update(self, progress: Progress) -> None:
        """Ignore it."""

    def say(self, text: str) -> None:
        """Ignore it."""

    def note(self, fact: Fact) -> None:
        """Ignore it."""
