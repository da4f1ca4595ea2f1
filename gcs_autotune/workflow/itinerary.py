"""The stages of a mission in their order, with their times; announced before the run and updated during it.

Times are vehicle times. The duration of a step is known. That of a self-oscillation depends on the craft. It is first
estimated from craft that steer in the same way, and then from the first one flown.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from gcs_autotune.axes import axis_kind, excitation_of
from gcs_autotune.craft import SteeredBy
from gcs_autotune.manoeuvres import LEVELS
from gcs_autotune.observer import Fact, Intentions, Observer, Progress
from gcs_autotune.workflow.preflight import STAGE
from gcs_autotune.workflow.settings import TuneSettings

__all__ = [
    "TURNING",
    "WALL_RELAY",
    "Itinerary",
    "Leg",
    "MissionLog",
    "Pace",
    "legs_beside",
    "legs_of_experiment",
    "legs_of_tune",
    "pace_of",
]

TURNING = "turning around"
DIVE, HOLD = 20.0, 10.0
"""Assumed duration [s] of a dive, and of the hold before a step that is flown for a fixed time."""
SETTLE, GAINS = 6.0, ("present", "new")
"""Time [s] before a turn-rate step that accompanies a heading step, and the names of the two sets of gains with which
it is flown.
"""


@dataclass(frozen=True, slots=True)
class Pace:
    """Duration [s] of stages that have no fixed length.

    ``check``, ``turn``: the sign check, and turning around.
    ``relay``, ``level``: a relay oscillation, and a throttle level, until they are steady.
    ``known``, ``answered``: their durations if they end early, once the gains are known or the boat has responded.
    ``rests``: the hold before a step until the craft is at rest.
    ``settles``: half of a position step, until the craft settles at its target.
    ``moving``: half of a speed or turn-rate step, until it settles.
    ``under_way``: whether the craft is a boat, which turns around between stages.
    """

    check: float
    turn: float
    relay: float
    level: float
    known: float
    answered: float
    rests: float
    settles: float
    moving: float
    under_way: bool = True


_PACES: Mapping[SteeredBy, Pace] = {
    "rudder": Pace(40.0, 32.0, 110.0, 12.0, 30.0, 7.0, 12.0, 24.0, 16.0),
    "thrusters": Pace(9.0, 11.0, 35.0, 10.0, 9.0, 5.0, 5.0, 10.0, 5.0),
    "rov": Pace(6.0, 0.0, 22.0, 10.0, 6.0, 7.0, 6.0, 8.0, 5.0, under_way=False),
}
"""Stage durations of simulated craft (Charlie; a BlueBoat; a BlueROV2, a VideoRay).

Before a craft has moved, its speed of response is unknown. Craft that thrusters turn are small and quick. Project
choice.
"""


_RESTLESS = 110.0
"""Duration [s] of a self-oscillation of a craft that does not come to rest, such as an ROV with a dead zone. Project
choice."""


def pace_of(steered_by: SteeredBy, *, restless: bool = False) -> Pace:
    """Return the assumed durations of stages for the type of steering *steered_by*.

    restless : whether the craft does not come to rest.
    """
    pace = _PACES[steered_by]
    return replace(pace, relay=max(pace.relay, _RESTLESS)) if restless else pace


@dataclass(frozen=True, slots=True)
class Leg:
    """One stage of a mission: its name, its duration [s], and the time [s] to turn around before it.

    Stages of one ``kind`` take the same time, so the first one flown is the estimate for the others. The name of an
    unplanned stage ends with its kind. ``trial`` : name of its record, if a run that is resumed may replace it.
    """

    stage: str
    seconds: float
    before: float = 0.0
    kind: str = ""
    trial: str = ""

    @property
    def total(self) -> float:
        """Duration of the stage [s], including the turn before it."""
        return self.seconds + self.before


def legs_of_tune(
    settings: TuneSettings,
    dof: str,
    pace: Pace,
    *,
    moving: bool,
    given: bool,
    dives: bool,
    beside: bool = False,
) -> tuple[Leg, ...]:
    """Return the stages of a tune.

    moving : whether the loop controls a velocity. given : whether the model is supplied, so that no experiments are
    flown. dives : whether an ROV dives first.
    beside : whether a turn-rate step accompanies the heading step.
    """
    turn = pace.turn
    step = _step_seconds(settings, pace, moving=moving)
    legs = _first(pace, dives=dives, steers=not excitation_of(dof).turns)
    before = Leg("step with present gains", step, kind="step", trial="step-before")
    thorough = moving or not settings.ends_early
    turn = turn if not settings.ends_early else 0.0
    flown = _swings(dof, pace) if thorough else _known(pace)
    swings = [] if given else [replace(swing, before=turn) for swing in flown]
    back = turn if swings else 0.0
    if swings and pace.under_way and excitation_of(dof).by_throttle and settings.ends_early:
        first = replace(swings[0], seconds=pace.answered * len(LEVELS[0]))
        swings, back = [first], pace.turn  # the step is the way back
    legs += [*swings, replace(before, before=back)] if moving else [before, *swings]
    if not settings.dry_run:
        rates = [Leg(f"turn rate with {gains} gains", SETTLE + 2.0 * pace.moving, turn, "turn rate") for gains in GAINS]
        legs += rates[:1] if beside else []
        legs.append(Leg("step with new gains", step, turn, "step"))
        legs += rates[1:] if beside else []
    return tuple(legs)


def legs_of_experiment(dof: str, pace: Pace, *, dives: bool) -> tuple[Leg, ...]:
    """Return the stages of an experiment."""
    first, second = _swings(dof, pace)
    return (
        *_first(pace, dives=dives, steers=not excitation_of(dof).turns),
        first,
        replace(second, before=pace.turn),
    )


WALL_RELAY = 130.0
"""Expected time of the relay on the distance to a wall [s]: a VideoRay of 16 s period (Miskovic2010, section 7.6)."""


def legs_beside(dof: str, pace: Pace, *, wall: float = 0.0) -> list[Leg]:
    """Return the stages that identify one more degree of freedom at rest; *wall* [s]: time of a relay on the distance
    to a wall, which is its own sign check.
    """
    first, second = (Leg(f"{n} {dof} self-oscillation", wall or pace.relay) for n in ("first", "second"))
    return [first] if wall else [Leg(STAGE, pace.check), first, second]


def _first(pace: Pace, *, dives: bool, steers: bool) -> list[Leg]:
    """Return the first stages: the sign check, also of the actuator that *steers* during the run, and the dive."""
    return [Leg(STAGE, pace.check * (2.0 if steers else 1.0))] + [Leg("diving", DIVE)] * dives


def _swings(dof: str, pace: Pace) -> list[Leg]:
    if excitation_of(dof).by_throttle and pace.under_way:
        return _two("throttle steps", "throttle", pace.level * len(LEVELS[0]))
    return _two("self-oscillation", "relay", pace.relay)


def _known(pace: Pace) -> list[Leg]:
    """Return the self-oscillations that end once the gains are known.

    There is one for a craft under way. There are two for a craft at rest, because its thrusters usually have a dead
    band.
    """
    legs = _two("self-oscillation", "relay", pace.known)
    return legs[:1] if pace.under_way else legs


def _two(kind: str, trial: str, seconds: float) -> list[Leg]:
    return [Leg(f"{n} {kind}", seconds, kind=kind, trial=f"{trial}-{k}") for k, n in enumerate(("first", "second"), 1)]


def _step_seconds(settings: TuneSettings, pace: Pace, *, moving: bool) -> float:
    """Return the seconds of the hold, the step and the step back."""
    each = settings.step_duration
    if each is None:
        kind = axis_kind(settings.axis)
        each = kind.guessed_duration if moving else kind.step_duration
    if not settings.ends_early:
        return HOLD + 2.0 * each
    return pace.rests + 2.0 * min(each, pace.moving if moving else pace.settles)


class Itinerary:
    """The progress through the stages, updated by the *stage* of each tick. An unplanned stage is inserted.

    turn : duration [s] of an unplanned turn.
    """

    def __init__(self, legs: Sequence[Leg], turn: float = 0.0) -> None:
        self.legs = list(legs)
        self._turn = turn
        self._now = -1
        self._turning = self._flown = False
        self._began = self._leg_began = self._t = math.nan

    @property
    def seconds(self) -> float:
        """Total duration of all stages [s]."""
        return sum(leg.total for leg in self.legs)

    def told(self) -> str:
        """Return a sentence with the stages and their times."""
        turns = [leg.before for leg in self.legs if leg.before > 0.0]
        pieces = [f"{leg.stage} {leg.seconds:.0f} s" for leg in self.legs]
        if turns:
            times = f" {len(turns)} times" if len(turns) > 1 else ""
            pieces.append(f"turning around{times} {turns[0]:.0f} s")
        return ", ".join(pieces)

    def at(self, progress: Progress) -> Progress:
        """Return *progress* with the number of its stage, the time since the start [s] and the remaining time [s]."""
        t = progress.t
        if not math.isfinite(self._began):
            self._began = t
        if math.isfinite(t):
            self._t = t
        self._find(progress.stage)
        if self._now < 0:
            return replace(progress, elapsed=t - self._began)
        leg = self.legs[self._now]
        left = max(leg.total - (self._t - self._leg_began), 0.0) + sum(x.total for x in self.legs[self._now + 1 :])
        return replace(progress, step=self._now + 1, steps=len(self.legs), elapsed=self._t - self._began, left=left)

    def _find(self, stage: str) -> None:
        if stage == TURNING:
            if not self._turning and self._now + 1 < len(self.legs):
                self._enter(self._now + 1)
                self._flown = False
                leg = self.legs[self._now]
                self.legs[self._now] = replace(leg, before=leg.before or self._turn)
            self._turning = True
            return
        self._turning = False
        if not stage or (self._now >= 0 and self.legs[self._now].stage == stage):
            self._flown = True
            return
        ahead = [i for i in range(max(self._now, 0), len(self.legs)) if self.legs[i].stage == stage]
        if not ahead:
            alike = [leg for leg in self.legs if leg.kind and stage.endswith(leg.kind)]
            at = self._now if self._now >= 0 and not self._flown else self._now + 1
            self.legs.insert(at, replace(alike[-1], stage=stage) if alike else Leg(stage, 0.0))
            ahead = [at]
        self._enter(ahead[0])
        self._flown = True

    def _enter(self, index: int) -> None:
        """Begin a stage. The duration of the previous one updates the estimate for others of its kind."""
        if 0 <= self._now < index:
            past = self.legs[self._now]
            took = self._t - self._leg_began - past.before
            alike = [i for i in range(index, len(self.legs)) if past.kind and self.legs[i].kind == past.kind]
            for i in alike if took > 0.0 else ():
                self.legs[i] = replace(self.legs[i], seconds=took)
        self._now, self._leg_began = index, self._t


class MissionLog:
    """Forwards everything to an observer; with an ``itinerary``, each tick also contains the number of its stage.

    ``way_on``: how to continue after an early end; empty if nothing can be reused.
    """

    def __init__(self, observer: Observer) -> None:
        self._observer = observer
        self.itinerary: Itinerary | None = None
        self.way_on = ""

    def update(self, progress: Progress) -> None:
        """Forward the progress at a control tick, with its stage if there is an itinerary."""
        self._observer.update(progress if self.itinerary is None else self.itinerary.at(progress))

    def say(self, text: str) -> None:
        """Forward a message for the operator."""
        self._observer.say(text)

    def note(self, fact: Fact) -> None:
        """Forward a note to the observer."""
        self._observer.note(fact)

    def announce(self, intentions: Intentions) -> None:
        """Announce what the mission will do, before anything moves."""
        self.note(intentions)
        for text in intentions.texts:
            self.say(f"will {text}")

    def abort(self, error: BaseException) -> None:
        """Record the reason why the mission ended early."""

    def offer_way_on(self, text: str) -> None:
        """Store and report how to continue after an early end: a sentence that ends with the command."""
        self.way_on = text
        self.say(text)
