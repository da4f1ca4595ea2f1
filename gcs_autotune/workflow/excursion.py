"""How far a run goes from the start and how long it takes, simulated before anything is armed.

A run is more than its manoeuvre: the sign check, the approach to speed, turning around, the way back and the distance
that the craft coasts at the end take space and time too. All stages are simulated one after the other
(:func:`gcs_autotune.manoeuvres.preview`). Where the craft is assumed, several craft are simulated, and the worst
counts. ``tune``, ``experiment``, ``fly`` and ``recheck`` announce these numbers and reject a limit that cannot be
kept.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from gcs_autotune.craft import Actuate, HeadingTarget, Observation
from gcs_autotune.frames import to_body
from gcs_autotune.manoeuvres import (
    ComeBack,
    Commands,
    Envelope,
    Manoeuvre,
    NominalPlant,
    Outcome,
    PlantState,
    Preview,
    TurnAbout,
    TurnAboutSettings,
    far_out,
    preview,
)
from gcs_autotune.trial import Trial

__all__ = [
    "NO_LIMITS",
    "Ahead",
    "Excursion",
    "VisitPreview",
    "least_distance",
    "overhead",
    "too_small",
    "worst_of",
]

ARMING, BETWEEN, LEAVING = 5.0, 1.5, 5.0
"""Seconds of making ready and arming, of neutral outputs and a change of mode between two stages, and of restoring the
vehicle; as the simulated autopilots took."""
STOPPED, LONGEST_COAST = 0.1, 60.0
"""Chosen: a craft slower than this [m/s] has stopped; with drag by the square it never quite does, so the second [s]
ends it."""
SPARE, SPARE_METRES = 1.2, 2.0
"""Chosen: margin on top of the worst craft, for wind, waves and noise: a factor, and at least so many metres."""
SUBMERGED, SUBMERGED_METRES = 1.1, 0.3
"""Chosen: the same below the surface, where neither wind nor waves move the vehicle."""
LATE = 1.05
"""Chosen: the same margin on the time."""
ROUNDED, EXACT = 5.0, 30.0
"""Chosen [m]: distances are announced in whole steps of the first; those below the second in whole metres."""
NO_LIMITS = Envelope(
    heading_excursion=math.inf, depth_excursion=math.inf, speed=math.inf, distance=math.inf, time=math.inf
)
"""Limits that end no preview, so that it shows all that a run takes."""


class Ahead(Manoeuvre):
    """Goes straight ahead at ``speed`` [m/s] for ``seconds``: what a stage that oscillates about a course takes.

    It may end where the space ends once it has lasted ``least`` [s].
    """

    kind = "ahead"
    in_manual = False

    def __init__(self, speed: float, seconds: float, name: str = "", least: float = math.inf) -> None:
        super().__init__(name)
        self._speed, self._seconds, self._least = speed, seconds, least
        self._elapsed = 0.0

    @property
    def asked(self) -> dict[str, float]:
        """Speed and time."""
        return {"speed": self._speed, "seconds": self._seconds}

    def commands(self, now: Observation) -> Commands:
        """Yield the course that it begins with."""
        course, start = now.psi, now.t
        while True:
            self._elapsed = now.t - start
            if self._elapsed >= self._seconds:
                self._end("completed", f"flew {self._seconds:.0f} s straight ahead")
            now = yield HeadingTarget(course, self._speed)

    def where_room_ends(self, where: str) -> Outcome | None:
        """End there once it has lasted long enough."""
        return Outcome("stopped", where) if self._elapsed >= self._least else None


class _Coast(Manoeuvre):
    """Outputs neutral for ``seconds``, or until the craft has stopped."""

    kind, purpose = "coast", "transit"

    def __init__(self, seconds: float) -> None:
        super().__init__()
        self._seconds = seconds

    @property
    def asked(self) -> dict[str, float]:
        """How long at most."""
        return {"seconds": self._seconds}

    def commands(self, now: Observation) -> Commands:
        """Yield neutral outputs."""
        start = now.t
        while True:
            if now.t - start >= self._seconds or math.hypot(now.u, now.v) <= STOPPED:
                self._end("completed", "stopped")
            now = yield Actuate()


class VisitPreview:
    """The simulation of one visit: stages of one *craft* one after the other, each beginning where the last one ended.

    *envelope* holds for every stage. ``trouble`` is what ended the first stage that ended badly.
    """

    def __init__(self, craft: NominalPlant, envelope: Envelope, begins: PlantState, *, under_way: bool) -> None:
        self._craft, self._envelope, self._under_way = craft, envelope, under_way
        self._state, self._seconds = begins, ARMING
        self.stages: list[tuple[str, Preview]] = []
        self.trouble = ""

    def fly(self, manoeuvre: Manoeuvre, stage: str, envelope: Envelope | None = None) -> Preview:
        """Fly *manoeuvre* and return its preview."""
        seen = preview(manoeuvre, self._craft, envelope or self._envelope, begins=self._state)
        self.stages.append((stage, seen))
        self._state = seen.ends
        self._seconds += seen.seconds
        if seen.trouble and not self.trouble:
            self.trouble = f"{stage}: {seen.trouble}"
        if self._under_way:
            self._coast(BETWEEN)
        self._seconds += BETWEEN
        return seen

    def turn_around(self, throttle: float, ahead: float, *, last: bool = False) -> None:
        """Turn a boat around as :meth:`gcs_autotune.workflow.runner.ManoeuvreRunner.turn_around` does."""
        away = math.hypot(self._state.x, self._state.y)
        if self._under_way and far_out(self._envelope, away, ahead, last=last):
            s = self._state
            side = -1.0 if to_body(-s.x, -s.y, s.psi)[1] < 0.0 else 1.0
            turn = TurnAboutSettings(throttle)
            self.fly(TurnAbout(replace(turn, output=side * turn.output)), "turning around", self._turning)

    def come_back(self, throttle: float, stage: str) -> None:
        """Bring a boat back to where the visit began."""
        if self._under_way:
            self.fly(ComeBack(0.0, 0.0, throttle), stage, self._turning)

    @property
    def _turning(self) -> Envelope:
        return replace(self._envelope, heading_excursion=math.inf)

    def _coast(self, seconds: float) -> None:
        seen = preview(_Coast(seconds), self._craft, NO_LIMITS, begins=self._state)
        self.stages.append(("", seen))
        self._state = seen.ends

    def excursion(self) -> Excursion:
        """Return what the visit takes, with the distance that the craft coasts once its outputs are neutral."""
        self._coast(LONGEST_COAST)
        named = [(name, p) for name, p in self.stages if name]
        trials = [p.trial for _, p in named]
        return Excursion(
            seconds=self._seconds + LEAVING,
            distance=max(p.away for _, p in self.stages),
            stages=tuple((name, p.seconds) for name, p in named),
            time=max((p.seconds for _, p in named), default=0.0),
            depth_max=_most(trials, "z", lambda z: float(z.max())),
            depth_excursion=_most(trials, "z", lambda z: float(np.abs(z - z[0]).max())),
            heading_excursion=_most(trials, "psi", lambda psi: float(np.abs(psi - psi[0]).max())),
            speed=_most(trials, "u", lambda u: float(np.abs(u).max())),
            turn_rate=_most(trials, "r", lambda r: float(np.abs(r).max())),
            trouble=self.trouble,
            submerged=not math.isnan(self._state.z),
        )


def _most(trials: Sequence[Trial], signal: str, of: Callable[[NDArray[np.float64]], float]) -> float:
    return max((of(trial[signal].values) for trial in trials if signal in trial), default=0.0)


@dataclass(frozen=True, slots=True)
class Excursion:
    """What a whole visit takes.

    Attributes
    ----------
    seconds : from arming until the vehicle is restored. distance : the greatest [m] from the start.
    stages : name and seconds of each.
    time : seconds of the longest stage. Of these and the others, the greatest as the envelope limits them: SI, rad.
    trouble : what ends it early; empty for nothing.
    usual : the same with a well damped loop; None: no loop is flown for long.
    least : the least of several craft, by name; empty for one craft.
    submerged : it is flown below the surface.
    """

    seconds: float
    distance: float
    stages: Sequence[tuple[str, float]] = ()
    time: float = 0.0
    depth_max: float = 0.0
    depth_excursion: float = 0.0
    heading_excursion: float = 0.0
    speed: float = 0.0
    turn_rate: float = 0.0
    trouble: str = ""
    usual: Excursion | None = None
    least: Mapping[str, float] = field(default_factory=dict)
    submerged: bool = False

    @property
    def needs(self) -> float:
        """The distance that it needs [m], with a margin, in whole steps."""
        factor, metres = (SUBMERGED, SUBMERGED_METRES) if self.submerged else (SPARE, SPARE_METRES)
        return rounded(max(factor * self.distance, self.distance + metres))

    def metres(self, envelope: Envelope) -> float:
        """Return the distance to announce [m]: what it needs, at most where *envelope* ends it."""
        return min(self.needs, envelope.distance_limit)

    def beyond(self, envelope: Envelope, what: str) -> str:
        """Return why *what* is rejected: a limit of *envelope* that it cannot keep, with the nearest that it can.

        Empty for nothing. Only limits that the user set count: distance and time as the worst craft needs them, others
        as every craft does. A loop is assumed to be well damped: else its run ends with the space.
        """
        usual = Envelope()
        for option, name, factor, unit in LIMITED:
            limit = getattr(envelope, name)
            value = SPARE * getattr(self, name) if name == "time" else self.least.get(name, getattr(self, name))
            value = (self.usual or self).needs if name == "distance" else value
            if limit is not None and limit != getattr(usual, name) and value > limit:
                shown = factor * value * (SPARE if name not in ("distance", "time") else 1.0)
                shown = math.ceil(shown) if shown >= 10.0 else math.ceil(10.0 * shown) / 10.0
                return too_small(what, option, factor * limit, shown, unit)
        return ""


_DEGREES = math.degrees(1.0)
LIMITED: Sequence[tuple[str, str, float, str]] = (
    ("max-distance", "distance", 1.0, "m"),
    ("max-time", "time", 1.0, "s"),
    ("max-speed", "speed", 1.0, "m/s"),
    ("max-heading-excursion", "heading_excursion", _DEGREES, "deg"),
    ("max-turn-rate", "turn_rate", _DEGREES, "deg/s"),
    ("max-depth", "depth_max", 1.0, "m"),
    ("max-depth-excursion", "depth_excursion", 1.0, "m"),
)
"""Options -> field of the envelope and of an excursion, its factor to the user's units, and that unit."""


def too_small(what: str, option: str, limit: float, needs: float, unit: str) -> str:
    """Return the sentences that reject a *limit* below what *what* *needs*, both in the user's *unit*."""
    return (
        f"not started: {what} needs {needs:g} {unit}, but the limit --{option} is {limit:g} {unit}. Nothing was armed. "
        f"Use --{option} {needs:g}, or fly a smaller, slower or shorter manoeuvre"
    )


def rounded(metres: float) -> float:
    """Return *metres* in whole steps, up."""
    step = ROUNDED if metres > EXACT else 1.0
    return step * math.ceil(metres / step)


_NUMBERS = ("distance", *(name for _, name, _, _ in LIMITED[1:]))


def worst_of(excursions: Sequence[Excursion]) -> Excursion:
    """Return the greatest of each number; the stages are those of the excursion that takes longest."""
    longest = max(excursions, key=lambda one: one.seconds)
    numbers = {name: [float(getattr(one, name)) for one in excursions] for name in _NUMBERS}
    most, least = ({name: of(values) for name, values in numbers.items()} for of in (max, min))
    trouble = next((one.trouble for one in excursions if one.trouble), "")
    return replace(longest, **most, trouble=trouble, least=least)  # type: ignore[arg-type]


def overhead(stages: int) -> float:
    """Return the seconds that a visit of so many stages takes in addition to them."""
    return ARMING + BETWEEN * stages + LEAVING


def least_distance(leaves: Callable[[float], bool], most: float) -> float:
    """Return the least distance limit [m] below *most* in which a visit that turns around comes to a good end.

    *leaves*: whether a visit inside a limit [m] leaves it all the same. NaN where not even *most* suffices.
    """
    if leaves(most):
        return math.nan
    low, high = 0.0, most
    while high - low > ROUNDED:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if leaves(middle) else (low, middle)
    return rounded(high)
