"""The stages of a tune or an experiment in their order, with how long each takes: told beforehand, kept while it runs.

Times are of the vehicle. What is flown by a clock (a step) is known; how long a self-oscillation takes is the craft's
affair, so it is estimated from craft of a few metres, and from the first one flown for the next.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

from gcs_autotune.axes import axis_kind, excitation_of
from gcs_autotune.manoeuvres import LEVELS
from gcs_autotune.watch import Fact, Progress, Watcher
from gcs_autotune.workflow.preflight import STAGE
from gcs_autotune.workflow.settings import SETTLED, TuneSettings

__all__ = ["TURNING", "Itinerary", "Leg", "Paced", "legs_of_experiment", "legs_of_tune"]

TURNING = "turning about"
CHECK, DIVE, TURN, RELAY, LEVEL = 25.0, 20.0, 32.0, 110.0, 12.0
"""Seconds of a sign check, a dive, a turn about, a self-oscillation and a throttle level. Chosen: as simulated craft
of half a metre to 2.4 m take."""
KNOWN_UNDER_WAY, KNOWN_AT_REST, ANSWERED = 30.0, 8.0, 7.0
"""...and of a self-oscillation that ends once the gains are known: one under way, two of a craft at rest, whose
thrusters mostly have a dead band; of a throttle level that ends once the boat has answered it."""
HOLD, RESTS, SETTLES = 10.0, 5.0, 12.0
"""Seconds of holding still before a step, and of one that ends once the craft is at rest; and until a half is over
that ends once the craft stands at its target."""


@dataclass(frozen=True, slots=True)
class Leg:
    """One stage: its name as the sequencer is told it, seconds, and those of turning about before it.

    Stages of one ``kind`` take alike: of the first flown, the others are guessed. One that was not planned is of the
    kind its name ends with.
    """

    stage: str
    seconds: float
    before: float = 0.0
    kind: str = ""

    @property
    def total(self) -> float:
        """Seconds with the turning about."""
        return self.seconds + self.before


def legs_of_tune(
    settings: TuneSettings, dof: str, *, under_way: bool, moving: bool, given: bool, dives: bool
) -> tuple[Leg, ...]:
    """Return the stages of a tune; *moving*: the loop is on a velocity; *given*: no experiments are flown."""
    turn = TURN if under_way else 0.0
    step = _step_seconds(settings, dof, moving=moving)
    legs = _first(dives=dives)
    before = Leg("step with present gains", step, kind="step")
    thorough = moving or settings.stop_rule == SETTLED
    turn = turn if settings.stop_rule == SETTLED else 0.0
    flown = _swings(dof, under_way) if thorough else _known(under_way)
    swings = [] if given else [replace(swing, before=turn) for swing in flown]
    back = turn if swings else 0.0
    if swings and under_way and excitation_of(dof).by_throttle and settings.stop_rule != SETTLED:
        first = replace(swings[0], seconds=ANSWERED * len(LEVELS[0]))
        swings, back = [first], TURN  # the step is the way back
    legs += [*swings, replace(before, before=back)] if moving else [before, *swings]
    if not settings.dry_run:
        legs.append(Leg("step with new gains", step, turn, "step"))
    return tuple(legs)


def legs_of_experiment(dof: str, *, under_way: bool, dives: bool) -> tuple[Leg, ...]:
    """Return the stages of an experiment."""
    first, second = _swings(dof, under_way)
    return (*_first(dives=dives), first, replace(second, before=TURN if under_way else 0.0))


def _first(*, dives: bool) -> list[Leg]:
    return [Leg(STAGE, CHECK)] + [Leg("diving", DIVE)] * dives


def _swings(dof: str, under_way: bool) -> list[Leg]:
    if excitation_of(dof).by_throttle and under_way:
        return _two("throttle steps", LEVEL * len(LEVELS[0]))
    return _two("self-oscillation", RELAY)


def _known(under_way: bool) -> list[Leg]:
    """Return the self-oscillations that end once the gains are known."""
    legs = _two("self-oscillation", KNOWN_UNDER_WAY if under_way else KNOWN_AT_REST)
    return legs[:1] if under_way else legs


def _two(kind: str, seconds: float) -> list[Leg]:
    return [Leg(f"{n} {kind}", seconds, kind=kind) for n in ("first", "second")]


def _step_seconds(settings: TuneSettings, dof: str, *, moving: bool) -> float:
    """Return seconds of holding, the step and the step back."""
    each = settings.step_duration
    if each is None:
        kind = axis_kind(settings.axis)
        each = kind.guessed_duration if moving else kind.step_duration
    if settings.stop_rule == SETTLED:
        return HOLD + 2.0 * each
    return RESTS + 2.0 * min(each, SETTLES)


class Itinerary:
    """Where one is in the stages, by the *stage* of each tick; one that was not planned is put in where it comes."""

    def __init__(self, legs: Sequence[Leg]) -> None:
        self.legs = list(legs)
        self._now = -1
        self._turning = self._flown = False
        self._began = self._leg_began = self._t = math.nan

    @property
    def seconds(self) -> float:
        """How long all of it takes."""
        return sum(leg.total for leg in self.legs)

    def told(self) -> str:
        """Return the stages with their times, in words."""
        turns = sum(leg.before > 0.0 for leg in self.legs)
        pieces = [f"{leg.stage} {leg.seconds:.0f} s" for leg in self.legs]
        if turns:
            pieces.append(f"turning about {turns} times {TURN:.0f} s" if turns > 1 else f"turning about {TURN:.0f} s")
        return ", ".join(pieces)

    def at(self, progress: Progress) -> Progress:
        """Return *progress* with the number of its stage, the time since the start and what is left."""
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
                self.legs[self._now] = replace(leg, before=leg.before or TURN)
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
        """Begin a leg; what the last one took is what others of its kind are now thought to take."""
        if 0 <= self._now < index:
            past = self.legs[self._now]
            took = self._t - self._leg_began - past.before
            if past.kind and took > 0.0:
                for i in range(index, len(self.legs)):
                    if self.legs[i].kind == past.kind:
                        self.legs[i] = replace(self.legs[i], seconds=took)
        self._now, self._leg_began = index, self._t


class Paced:
    """A watcher that tells another where in the stages each tick is."""

    def __init__(self, watcher: Watcher, itinerary: Itinerary) -> None:
        self._watcher = watcher
        self._itinerary = itinerary

    def update(self, progress: Progress) -> None:
        """Pass the tick on."""
        self._watcher.update(self._itinerary.at(progress))

    def say(self, text: str) -> None:
        """Pass it on."""
        self._watcher.say(text)

    def note(self, fact: Fact) -> None:
        """Pass it on."""
        self._watcher.note(fact)
