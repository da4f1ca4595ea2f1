"""Throttle steps under way, which identify a boat's surge.

A relay on speed would need equal thrust ahead and astern. A boat under way only has thrust ahead, about quadratic in
throttle. So the information is in how fast it gains and loses speed. The manoeuvre holds a working throttle, then
levels well apart, one of them zero, each until the speed is steady.

A low-gain heading hold keeps the course, except while coasting. With two thrusters the one astern is weaker, so
differential steering pushes ahead at zero throttle. On a BlueBoat 1 % of steering gives 0.25 % of full throttle, which
distorts the thrust curve. A rudder outside the propeller's wash has little effect.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from gcs_autotune.craft import Actuate, Command, Observation
from gcs_autotune.manoeuvres.approach import Approach
from gcs_autotune.manoeuvres.hold_controller import HeadingHold
from gcs_autotune.manoeuvres.manoeuvre import Commands, Manoeuvre, Outcome

__all__ = ["BOTH_WAYS", "LEVELS", "ThrottleSteps", "ThrottleStepsSettings"]

LEVELS: tuple[tuple[float, ...], ...] = ((0.45, 1.35, 0.0, 1.0), (0.0, 1.35, 0.7, 1.0))
"""Throttle levels of the two runs, relative to the working throttle, at which each run starts and ends.

Coasting separates drag from inertia. A high and a low level separate the thrust curve from the drag curve. The order
differs between the runs. Project choice.
"""
BOTH_WAYS: tuple[float, ...] = (1.0, -0.5, 0.5, -1.0, 0.75, -0.75, 0.25, -0.25, 0.12, 0.0, 0.5, 0.0)
"""Throttle levels as fractions of full throttle, of a run that shows the thrust ahead and astern.

A level astern brakes the boat. The lowest ones show a dead zone, and coasting shows the drag. Project choice.
"""

STEADY_WINDOW = 3.0
STEADY_SHARE = 0.04
"""Change of speed over the window, as a fraction of the working speed, below which the speed counts as steady. Project
choice.
"""
NOISE_STDS = 2.0
"""Change of speed, in standard errors, below which the speed also counts as steady. Project choice."""
ANSWERED = 0.08
"""Fraction of the whole change of speed below which a level counts as complete.

It is compared with the difference between the mean speeds of the last two quarters of the level. For any boat this
corresponds to three time constants, i.e. 95 % of the change. Project choice.
"""
COASTED = 0.35
"""Fraction of the working speed at which coasting ends, so that the rudder regains effect."""
BACKED, SLOWED = 0.4, 0.1
"""Speed astern at which a level astern ends, and speed ahead below which it may end, as fractions of the working speed.
Project choice.
"""
FEW = 5
"""Number of readings averaged for the initial speed of a level. Project choice."""
TELLING = 2
"""Number of complete levels that is sufficient for an identification, if the run ends at the space limit.
Project choice.
"""
BEFORE = 2.0
"""Time [s] of the steady approach included in the record, for the initial state of the first step. Project choice."""


@dataclass(frozen=True, slots=True)
class ThrottleStepsSettings:
    """Settings of throttle steps.

    ``throttle``: working throttle (normalised).
    ``levels``: throttle levels relative to the working throttle, negative ones astern; ``most``: the largest throttle.
    ``least_time``, ``most_time`` [s]: shortest and longest duration of a level.
    ``least_speed`` [m/s]: lowest usable speed.
    ``most_speed`` [m/s]: a level ahead ends at this speed.
    ``until_answered``: a level ends once its response is complete, steady or not.
    """

    throttle: float
    levels: Sequence[float] = LEVELS[0]
    most: float = 1.0
    least_time: float = 4.0
    most_time: float = 12.0
    least_speed: float = 0.2
    most_speed: float = math.inf
    until_answered: bool = False


class ThrottleSteps(Manoeuvre):
    """Fly an approach at the working throttle, then the throttle levels. The manoeuvre marks ``level`` at each change
    and ``steady`` before it.
    """

    kind = "throttle-steps"

    def __init__(
        self,
        settings: ThrottleStepsSettings,
        name: str = "throttle-steps",
    ) -> None:
        super().__init__(name, signal="u", force="X")
        self._settings = settings
        self._approach = Approach("u", needs_way=True)
        self._heading_hold = HeadingHold()
        self._levels = [min(share * settings.throttle, settings.most) for share in settings.levels]
        self._level = settings.throttle
        self._next = 0
        self._since = self._began = math.nan
        self._seen: deque[tuple[float, float, float]] = deque()
        self._of_level: list[float] = []
        self._from = math.nan

    @property
    def meta_fields(self) -> Mapping[str, Any]:
        """Settings as flown, by name, for the trial's ``meta``; ``from_t`` [s] is shortly before the first step."""
        s = self._settings
        return {
            "dof": "surge",
            "thrust_curve": True,
            "signal": "u",
            "force": "X",
            "throttle": s.throttle,
            "levels": list(self._levels),
            "noise_std": self._approach.noise_std,
            "speed": self._approach.speed,
            "reference": self._approach.speed,
            "from_t": self._began,
        }

    def commands(self, now: Observation) -> Commands:
        """Yield the commands of the approach, then each throttle level until its response is complete."""
        self._approach.start(now)
        self._heading_hold.start(now)
        while True:
            command = self._tick(now)
            self.phase = "approach" if math.isnan(self._began) else f"throttle {100.0 * self._level:.0f} %"
            now = yield command

    def where_room_ends(self, where: str) -> Outcome | None:
        """Return the outcome "stopped" if the levels recorded are sufficient; else None."""
        flown = self._next - 1
        if flown < TELLING:
            return None
        return Outcome(
            "stopped",
            f"out of space after {flown} of {len(self._levels)} throttle levels: {where}. The record so far is used",
        )

    def _tick(self, observation: Observation) -> Command:
        if math.isfinite(observation.u):
            self._take(observation)
        elif not self._approach.done and observation.t - self._first(observation) > self._settings.most_time:
            self._end("aborted", "the vehicle reports no speed. Check that it has a position fix")
        return Actuate(X=self._level, N=self._heading_hold.steer(observation) if self._level > 0.0 else 0.0)

    def _first(self, observation: Observation) -> float:
        if math.isnan(self._since):
            self._since = observation.t
        return self._since

    def _take(self, observation: Observation) -> None:
        t, u = observation.t, observation.u
        self._seen.append((t, u, observation.output.get("X", math.nan)))
        self._of_level.append(u)
        while self._seen[0][0] < t - STEADY_WINDOW:
            self._seen.popleft()
        if math.isnan(self._began):
            self._approach.update(t, u, u)
            if self._approach.done:
                self._begin(t)
            return
        elapsed, s = t - self._since, self._settings
        steady = elapsed >= s.least_time and self._is_steady()
        answered = s.until_answered and elapsed >= s.least_time and self._has_answered()
        if steady or answered or self._is_spent(u, elapsed) or elapsed >= s.most_time:
            self._step(t, steady=steady)

    def _begin(self, t: float) -> None:
        speed, s = self._approach.speed, self._settings
        if not speed >= s.least_speed:
            self._end(
                "aborted",
                f"the boat makes {speed:.2f} m/s at {s.throttle:.0%} throttle, less than the {s.least_speed:g} m/s "
                "required. Use a larger --throttle, or check the propeller's direction",
            )
            return
        self._began = t - BEFORE
        self._mark_steady(t)
        self._step(t, steady=False)

    def _kept(self, t: float) -> tuple[float, float]:
        """Return speed [m/s] and throttle, as measured over the later half of the window."""
        half = [(u, x) for when, u, x in self._seen if when >= t - 0.5 * STEADY_WINDOW]
        u, x = (float(np.nanmean(column)) for column in zip(*half, strict=True))
        return u, x

    def _mark_steady(self, t: float) -> None:
        u, x = self._kept(t)
        self._mark(t, "steady", {"u": u, "X": x, "level": self._level})

    def _step(self, t: float, *, steady: bool) -> None:
        if steady:
            self._mark_steady(t)
        if self._next == len(self._levels):
            self._end("completed", f"{len(self._levels)} throttle levels flown")
            return
        self._level = self._levels[self._next]
        self._next += 1
        self._since = t
        self._from = float(np.mean(self._of_level[-FEW:]))
        self._seen.clear()
        self._of_level.clear()
        self._mark(t, "level", {"X": self._level})

    def _is_spent(self, u: float, elapsed: float) -> bool:
        """Return whether the speed *u* [m/s] ends the level: too fast, coasted out, stopped or going astern."""
        s, speed = self._settings, self._approach.speed
        if self._level > 0.0:
            return u >= s.most_speed
        if self._level == 0.0:
            return u <= COASTED * speed
        return u <= -BACKED * speed or (elapsed >= s.least_time and u <= SLOWED * speed)

    def _has_answered(self) -> bool:
        quarter = len(self._of_level) // 4
        if not quarter:
            return False
        before, last = (float(np.mean(part)) for part in np.split(np.array(self._of_level[-2 * quarter :]), 2))
        return abs(last - before) < ANSWERED * abs(last - self._from)

    def _is_steady(self) -> bool:
        if not self._seen or self._seen[-1][0] - self._seen[0][0] < 0.8 * STEADY_WINDOW:
            return False
        speeds = [u for _, u, _ in self._seen]
        half = len(speeds) // 2
        change = abs(float(np.mean(speeds[half:])) - float(np.mean(speeds[:half])))
        noise = NOISE_STDS * self._approach.noise_std / math.sqrt(max(half, 1))
        return change < max(STEADY_SHARE * 0.5 * self._approach.speed, noise)
