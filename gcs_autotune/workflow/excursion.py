"""How far a run goes from its start and how long it takes, simulated before arming.

The sign check, the approach to speed, turning around, the return and the final coasting also take space and time. All
stages are simulated one after the other (:func:`gcs_autotune.manoeuvres.preview`). If the craft is assumed, several
craft are simulated and the worst one counts. ``tune``, ``experiment``, ``fly`` and ``recheck`` announce these numbers.
They reject a limit that cannot be kept.
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
    TurnAround,
    TurnAroundSettings,
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
"""Seconds for preparing and arming; for neutral outputs and a mode change between two stages; and for restoring the
vehicle. Measured on the simulated autopilots."""
STOPPED, LONGEST_COAST = 0.1, 60.0
"""Speed [m/s] below which a craft counts as stopped, and the longest simulated coast [s].

With quadratic drag the speed never quite reaches zero, so the longest coast ends the simulation. Project choice.
"""
SPARE, SPARE_METRES = 1.2, 2.0
"""Margin over the craft that needs most, for wind, waves and noise.

It is a factor, and a minimum in metres. Project choice.
"""
SUBMERGED, SUBMERGED_METRES = 1.1, 0.3
"""The margin for a submerged vehicle, which neither wind nor waves move: a factor, and a minimum in metres. Project
choice."""
LATE = 1.05
"""Factor by which the announced time exceeds the simulated time. Project choice."""
ROUNDED, EXACT = 5.0, 30.0
"""Announced distances are rounded to multiples of the first [m]; those below the second [m] to whole metres. Project
choice."""
NO_LIMITS = Envelope(
    heading_excursion=math.inf, depth_excursion=math.inf, speed=math.inf, distance=math.inf, time=math.inf
)
"""Limits that never end a preview, so that it shows everything that a run needs."""


class Ahead(Manoeuvre):
    """Straight run at ``speed`` [m/s] for ``seconds``, as a substitute for a stage that oscillates about a course.

    It may end at the limit of the space once it has lasted ``least`` [s].
    """

    kind = "ahead"
    in_manual = False

    def __init__(self, speed: float, seconds: float, name: str = "", least: float = math.inf) -> None:
        super().__init__(name)
        self._speed, self._seconds, self._least = speed, seconds, least
        self._elapsed = 0.0

    @property
    def meta_fields(self) -> dict[str, float]:
        """Requested speed [m/s] and duration [s], by name."""
        return {"speed": self._speed, "seconds": self._seconds}

    def commands(self, now: Observation) -> Commands:
        """Yield the command to keep the initial course, until the end of the stage."""
        course, start = now.psi, now.t
        while True:
            self._elapsed = now.t - start
            if self._elapsed >= self._seconds:
                self._end("completed", f"flew {self._seconds:.0f} s straight ahead")
            now = yield HeadingTarget(course, self._speed)

    def where_room_ends(self, where: str) -> Outcome | None:
        """Return the outcome "stopped" at the space limit *where*, if the stage has lasted ``least`` [s]; else None."""
        return Outcome("stopped", where) if self._elapsed >= self._least else None


class _Coast(Manoeuvre):
    """A manoeuvre with neutral outputs for ``seconds``, or until the craft has stopped."""

    kind, purpose = "coast", "transit"

    def __init__(self, seconds: float) -> None:
        super().__init__()
        self._seconds = seconds

    @property
    def meta_fields(self) -> dict[str, float]:
        """Longest duration [s], by name."""
        return {"seconds": self._seconds}

    def commands(self, now: Observation) -> Commands:
        """Yield neutral outputs until the craft has stopped."""
        start = now.t
        while True:
            if now.t - start >= self._seconds or math.hypot(now.u, now.v) <= STOPPED:
                self._end("completed", "stopped")
            now = yield Actuate()


class VisitPreview:
    """Simulation of one run: the stages of one *craft*, each starting where the previous one ended.

    *envelope* applies to every stage. ``trouble`` is the reason why the first unsuccessful stage ended.
    """

    def __init__(self, craft: NominalPlant, envelope: Envelope, begins: PlantState, *, under_way: bool) -> None:
        self._craft, self._envelope, self._under_way = craft, envelope, under_way
        self._state, self._seconds = begins, ARMING
        self.stages: list[tuple[str, Preview]] = []
        self.trouble = ""

    def fly(self, manoeuvre: Manoeuvre, stage: str, envelope: Envelope | None = None) -> Preview:
        """Simulate *manoeuvre* from the end of the last stage, and return its preview."""
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
        """Turn a boat around in the same way as :meth:`gcs_autotune.workflow.runner.ManoeuvreRunner.turn_around`."""
        away = math.hypot(self._state.x, self._state.y)
        if self._under_way and far_out(self._envelope, away, ahead, last=last):
            s = self._state
            side = -1.0 if to_body(-s.x, -s.y, s.psi)[1] < 0.0 else 1.0
            turn = TurnAroundSettings(throttle)
            self.fly(TurnAround(replace(turn, output=side * turn.output)), "turning around", self._turning)

    def come_back(self, throttle: float, stage: str) -> None:
        """Simulate the return of a boat to the start of the run."""
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
        """Return the excursion of the whole run, including the distance coasted after the outputs are neutral."""
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
    """Space and time that a whole run needs.

    Attributes
    ----------
    seconds : time [s] from arming until the vehicle is restored.
    distance : greatest distance [m] from the start.
    stages : name and duration [s] of each stage.
    time : duration [s] of the longest stage.
        All other numbers are the greatest values of what the envelope limits: SI, rad.
    trouble : reason for an early end; empty if there is none.
    usual : the excursion with a well damped loop; None: no loop is flown for long.
    least : the smallest numbers among several craft, by name; empty for one craft.
    submerged : whether the run is flown below the surface.
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
        """The required distance [m] with a margin, rounded up to announced distances."""
        factor, metres = (SUBMERGED, SUBMERGED_METRES) if self.submerged else (SPARE, SPARE_METRES)
        return rounded(max(factor * self.distance, self.distance + metres))

    def metres(self, envelope: Envelope) -> float:
        """Return the distance to announce [m]: the required one, or the limit of *envelope* if that is smaller."""
        return min(self.needs, envelope.distance_limit)

    def beyond(self, envelope: Envelope, what: str) -> str:
        """Return why *what* is rejected: a limit of *envelope* that *what* would exceed, and the nearest sufficient
        value. Empty if no limit is exceeded. Only limits that the user set count. Distance and time are those of the
        worst craft; other limits count only if every craft exceeds them. The loop is assumed to be well damped, because
        otherwise its run ends at the limit of the space.
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
"""Option -> (field of the envelope, field of an excursion, factor to the user's unit, that unit)."""


def too_small(what: str, option: str, limit: float, needs: float, unit: str) -> str:
    """Return sentences that reject a *limit* that is smaller than the *needs* of *what*, both in the user's *unit*."""
    return (
        f"not started: {what} needs {needs:g} {unit}, but the limit --{option} is {limit:g} {unit}. Nothing was armed. "
        f"Use --{option} {needs:g}, or fly a smaller, slower or shorter manoeuvre"
    )


def rounded(metres: float) -> float:
    """Return *metres* rounded up to a multiple of :data:`ROUNDED`; below :data:`EXACT`, to whole metres."""
    step = ROUNDED if metres > EXACT else 1.0
    return step * math.ceil(metres / step)


_NUMBERS = ("distance", *(name for _, name, _, _ in LIMITED[1:]))


def worst_of(excursions: Sequence[Excursion]) -> Excursion:
    """Return one excursion with the greatest of each number of *excursions*. The stages are those of the excursion that
    takes longest.
    """
    longest = max(excursions, key=lambda one: one.seconds)
    numbers = {name: [float(getattr(one, name)) for one in excursions] for name in _NUMBERS}
    most, least = ({name: of(values) for name, values in numbers.items()} for of in (max, min))
    trouble = next((one.trouble for one in excursions if one.trouble), "")
    return replace(longest, **most, trouble=trouble, least=least)  # type: ignore[arg-type]


def overhead(stages: int) -> float:
    """Return the time [s] that a run of *stages* stages takes in addition to the stages themselves."""
    return ARMING + BETWEEN * stages + LEAVING


def least_distance(leaves: Callable[[float], bool], most: float) -> float:
    """Return the smallest distance limit [m] below *most* within which a run with turns is completed.

    *leaves*: whether a run with that limit [m] exceeds it nevertheless. NaN if *most* is not sufficient.
    """
    if leaves(most):
        return math.nan
    low, high = 0.0, most
    while high - low > ROUNDED:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if leaves(middle) else (low, middle)
    return rounded(high)
