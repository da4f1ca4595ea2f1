"""Progress reports of a running manoeuvre.

The sequencer and the workflow pass a :class:`Progress` to a :class:`Observer` at every control tick, and a :data:`Fact`
when there is one. The observer shows it as a live line, a log or a page. It must return at once, because the calling
loop controls the vehicle.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Protocol

__all__ = [
    "Fact",
    "Intention",
    "Intentions",
    "LeftAs",
    "ListedStep",
    "NewValue",
    "Observer",
    "PredictedCost",
    "PredictedTrack",
    "Progress",
    "ProposedGains",
    "Room",
    "SilentObserver",
    "StepList",
    "Vitals",
    "Words",
    "stopping",
]


@dataclass(frozen=True, slots=True)
class Progress:
    """State of a manoeuvre at one moment, in SI units and radians. Unknown numbers are NaN.

    ``signal`` is the controlled signal (``psi``, ``z``, ``x``) and ``target`` its reference. ``output`` is the actuator
    demand [fraction of full]. ``periods`` and ``periods_needed`` count oscillations that satisfy the stop rule;
    ``scatter`` is their relative spread. ``guard`` and ``guard_share`` are the safety limit nearest to tripping and the
    fraction of it that is used (0..1). ``step`` of ``steps`` is the present stage (0: not known), ``elapsed`` and
    ``left`` are seconds since the start and to the end, if known. ``rate`` is the time derivative of the controlled
    signal. ``x``, ``y`` [m north, east] and ``psi`` [rad] are the position and heading of the craft.
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
    """The space limits of the current manoeuvre.

    ``x``, ``y`` [m north, east] is the origin of ``distance`` [m]. ``zones`` are (corners [m north, east], radius [m],
    whether the craft must stay inside); a circle has one corner. ``bounds`` is signal -> (least, greatest), in SI and
    radians. Unknown numbers are NaN, absent limits infinite.
    """

    x: float
    y: float
    distance: float
    zones: tuple[tuple[tuple[tuple[float, float], ...], float, bool], ...] = ()
    bounds: Mapping[str, tuple[float, float]] | None = None


@dataclass(frozen=True, slots=True)
class Vitals:
    """State of the vehicle, about once a second.

    Battery voltage [V], remaining charge [0..1], round trip [s] and rate of ATTITUDE [Hz]; NaN: unknown.
    """

    mode: str
    armed: bool
    battery_voltage: float = math.nan
    battery_remaining: float = math.nan
    round_trip: float = math.nan
    attitude_rate: float = math.nan


@dataclass(frozen=True, slots=True)
class Words:
    """A STATUSTEXT of the vehicle, unmodified; ``severity`` 0 (emergency) to 7 (debug)."""

    severity: int
    text: str


@dataclass(frozen=True, slots=True)
class Intention:
    """One sentence of the announcement, without its "will".

    row : its row in the table that a terminal shows, with *brief* beside it; empty for a sentence without a row.
    is_usual : whether every run with the usual settings does so. A terminal then shows the sentence only with
        ``--verbose``.
    """

    text: str
    row: str = ""
    brief: str = ""
    is_usual: bool = False


@dataclass(frozen=True, slots=True)
class Intentions:
    """The announcement before any question or motion. Its sentences are also reported one by one.

    ``texts``: one sentence per intention, without its "will".
    """

    each: tuple[Intention, ...]
    texts: tuple[str, ...] = field(init=False)

    def __post_init__(self) -> None:
        """Write the sentences out, for observers that pass the announcement on as data."""
        object.__setattr__(self, "texts", tuple(intention.text for intention in self.each))


@dataclass(frozen=True, slots=True)
class NewValue:
    """One parameter to be written, by the vehicle's own name: old value, new value, reason."""

    parameter: str
    old: float
    new: float
    reason: str


@dataclass(frozen=True, slots=True)
class ProposedGains:
    """The proposed parameters, before the question whether to write them.

    ``cost_before``, ``cost_after`` are the ITAE of the step per unit step [s^2] predicted by the model; NaN without
    model. ``cost_worst`` is ``cost_after`` at the worst point of the 95 % region of the model.
    """

    values: tuple[NewValue, ...]
    cost_before: float = math.nan
    cost_after: float = math.nan
    cost_worst: float = math.nan


@dataclass(frozen=True, slots=True)
class PredictedCost:
    """Predicted ITAE of the step per unit step [s^2] with the gains that would be designed now.

    ``nominal`` is that of the model fitted so far, ``worst`` the largest in the 95 % region of its parameters.
    """

    nominal: float
    worst: float


@dataclass(frozen=True, slots=True)
class PredictedTrack:
    """The preview of a run, before it is flown.

    ``x``, ``y`` [m north, east] and ``psi`` [rad] are the craft's position and heading at that time. ``ahead``,
    ``abeam`` [m] is the track relative to them. ``told`` is a sentence on time, space and turning; ``trouble`` is the
    reason not to fly it.
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
class ListedStep:
    """One step of a job: its ``name``, its ``state`` and the ``reason`` for it.

    state : ``open``, ``flying``, or how the step ended. seconds : announced duration [s] of the vehicle's time.
    """

    name: str
    state: str
    reason: str = ""
    seconds: float = math.nan


@dataclass(frozen=True, slots=True)
class StepList:
    """All steps of a job of several, in order, whenever one of them changes."""

    steps: tuple[ListedStep, ...]


@dataclass(frozen=True, slots=True)
class LeftAs:
    """The final state of the craft: mode and armed state from its heartbeat, and what ``differs`` from the original."""

    mode: str
    armed: bool
    differs: Mapping[str, str]


Fact = Intentions | Room | Vitals | Words | ProposedGains | PredictedCost | PredictedTrack | StepList | LeftAs
"""A note that is reported in addition to ticks and sentences."""


class Observer(Protocol):
    """Interface of a receiver of progress reports."""

    def update(self, progress: Progress) -> None:
        """Process the progress at one control tick."""
        ...

    def say(self, text: str) -> None:
        """Process an event, described in one sentence."""
        ...

    def note(self, fact: Fact) -> None:
        """Process a note, or ignore it."""
        ...


class SilentObserver:
    """An observer that ignores everything."""

    def update(self, progress: Progress) -> None:
        """Ignore the control tick."""

    def say(self, text: str) -> None:
        """Ignore the event."""

    def note(self, fact: Fact) -> None:
        """Ignore the note."""


def stopping(*, again: bool) -> str:
    """Return the reply to a request to stop, or to one more of them if *again*."""
    if again:
        return "Still restoring the vehicle. Please wait."
    return "Stopping: setting the actuators to neutral and restoring the vehicle, unless this is done already."
