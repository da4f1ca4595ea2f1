"""The approach before a manoeuvre: gain speed if needed, and measure the noise of the monitored signal.

:class:`UnderWay` is the base class of the standard ship manoeuvres (zig-zag, circle, spiral, stopping). It consists of
an approach straight ahead and helm orders, each held until the craft turns steadily.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Generator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from gcs_autotune.craft import Actuate, Command, Observation
from gcs_autotune.manoeuvres.hold_controller import HELD_DURING, HeadingHold, HoldController, hold
from gcs_autotune.manoeuvres.manoeuvre import Manoeuvre

__all__ = ["Approach", "Part", "Steadiness", "Steering", "UnderWay"]

Part = Generator[Command, Observation, Observation]
"""A generator for one section of a manoeuvre. It yields commands, receives observations, and returns the first
observation of the next section.
"""

LEAST_TIME = 3.0
"""Shortest approach [s]: enough samples at 10 Hz to determine the noise within about 15 %. Project choice."""
LONGEST_TIME = 30.0
"""Longest approach [s]. A boat that still accelerates after this time starts the manoeuvre anyway. Project choice."""
STEADY_WINDOW = 3.0
STEADY_SHARE = 0.03
"""Change of speed over :data:`STEADY_WINDOW` below which the speed counts as steady, as a fraction of the speed; at
least 2 cm/s. Project choice.
"""
STEADY_SPEED = 0.015
"""Change of mean speed from one :data:`STEADY_WINDOW` to the next at which an approach ends, as a fraction of the
speed. A craft that gains speed exponentially is then within about as much of its final speed. Project choice.
"""
STEADY_RATE = 0.02
"""Change of turn rate over the window below which a turn counts as steady, as a fraction of the largest turn rate
measured. Project choice.
"""
COURSE_WINDOW = 1.0
"""Time [s] at the end of the approach over which the heading is averaged, because one compass sample is too noisy.
Project choice."""
LONGEST_HOLD = 60.0
"""Longest hold [s] of a helm whose turn does not become steady (waves, an unstable craft). Project choice."""


class Steadiness:
    """Detects whether a signal is steady, by comparing the means of both halves of the last ``window`` [s]."""

    def __init__(self, window: float = STEADY_WINDOW) -> None:
        self.window = window
        self._seen: deque[tuple[float, float]] = deque()
        self._start = math.nan

    def update(self, t: float, x: float) -> None:
        """Add one sample: time [s] and value."""
        if not self._seen:
            self._start = t
        self._seen.append((t, x))
        while self._seen[0][0] < t - self.window:
            self._seen.popleft()

    @property
    def halves(self) -> tuple[float, float] | None:
        """Means of the earlier and the later half of the window; None before the window is full, or if a value
        is unknown.
        """
        values = [x for _, x in self._seen]
        if not values or self._seen[-1][0] - self._start < self.window or not all(math.isfinite(x) for x in values):
            return None
        half = len(values) // 2
        return float(np.mean(values[:half])), float(np.mean(values[half:]))

    @property
    def mean(self) -> float:
        """Mean of the known values in the window; NaN without known values."""
        known = [x for _, x in self._seen if math.isfinite(x)]
        return float(np.mean(known)) if known else math.nan

    def is_within(self, band: float) -> bool:
        """Return whether the means of both halves of the window differ by less than *band*."""
        halves = self.halves
        return halves is not None and abs(halves[1] - halves[0]) < band


class Approach:
    """Approach before a manoeuvre: wait until the speed is steady (if the actuator needs speed) and the noise is
    measured.

    ``noise_std`` is computed from second differences, which a steady turn or drift does not affect.
    """

    def __init__(self, signal: str, *, needs_way: bool) -> None:
        self.signal = signal
        self.done = False
        self.noise_std = 0.0
        self.speed = math.nan
        self._needs_way = needs_way
        self._start = math.nan
        self._x: list[float] = []
        self._speeds = Steadiness()

    def skip(self, noise_std: float) -> None:
        """End the approach at once, because the craft is at speed and the noise [rad or m] is known."""
        self.noise_std, self.done = noise_std, True

    def start(self, observation: Observation) -> None:
        """Start the approach with the time and the speed of the first observation."""
        self.speed = observation.speed
        self._start = observation.t

    def update(self, t: float, x: float, speed: float) -> None:
        """Process one sample: time [s], monitored signal [rad or m], speed [m/s] (NaN if unknown). End the
        approach once it is complete.
        """
        self._x.append(x)
        self._speeds.update(t, speed)
        elapsed = t - self._start
        if elapsed < LEAST_TIME:
            return
        if not self._needs_way or self._is_steady() or elapsed >= LONGEST_TIME:
            self._finish()

    def _is_steady(self) -> bool:
        halves = self._speeds.halves
        return halves is not None and halves[1] > 0.0 and self._speeds.is_within(max(STEADY_SHARE * halves[1], 0.02))

    def _finish(self) -> None:
        tail = np.diff(np.asarray(self._x[-60:]), n=2)
        self.noise_std = float(np.sqrt(np.mean(tail**2) / 6.0)) if len(tail) else 0.0
        self.speed = self._speeds.mean
        self.done = True


@dataclass(frozen=True, slots=True)
class Steering:
    """How a craft is steered during a standard manoeuvre.

    Attributes
    ----------
    share : rudder or yaw moment, as a fraction of full output.
    side : 1 to begin to starboard, -1 to port.
    throttle : constant thrust ahead.
    full_rudder : rudder angle [rad] at full steering output; None if there is no rudder or it is unknown.
    keep_still : whether to hold an ROV's depth during the manoeuvre.
    """

    share: float
    side: int = 1
    throttle: float = 0.0
    full_rudder: float | None = None
    keep_still: bool = False

    @classmethod
    def of(cls, options: Mapping[str, float]) -> Steering:
        """Return the steering in *options*, which are those of an entry in the table of manoeuvres."""
        return cls(
            options.get("steering", 0.0),
            int(options["side"]),
            options["throttle"],
            options.get("full-rudder"),
            bool(options["keep-still"]),
        )


class UnderWay(Manoeuvre):
    """A manoeuvre that begins with an approach straight ahead. Marks ``execute`` where the helm is put over.

    The noise of ``signal`` is measured during the approach.
    """

    def __init__(self, steering: Steering, name: str = "", *, signal: str = "psi", force: str = "N") -> None:
        super().__init__(name, signal=signal, force=force)
        self._steering = steering
        self._approach = Approach(signal, needs_way=steering.throttle != 0.0)
        self._heading_hold = HeadingHold()
        self._holds = [HoldController(gains) for gains in HELD_DURING["psi"]] if steering.keep_still else []
        self._fastest, self._course = 0.0, math.nan
        self._rates: list[tuple[float, float]] = []

    @property
    def meta_fields(self) -> Mapping[str, Any]:
        """Settings of the steering and results of the approach by name, for the trial's ``meta``."""
        s = self._steering
        return {
            "dof": "yaw",
            "signal": self.signal,
            "force": self.force,
            "steering": s.side * s.share,
            **({} if s.full_rudder is None else {"full_rudder": s.full_rudder}),
            "throttle": s.throttle,
            "noise_std": self._approach.noise_std,
            "speed": self._approach.speed,
        }

    def _approached(self, now: Observation) -> Part:
        """Go straight ahead until the speed is steady, then for as long again, since it still increases slowly, and
        until its mean no longer changes from one window to the next.

        One steady window is not enough: a craft that slowed down for a sign check is about to gain speed again.
        A low-gain heading hold steers a craft that steers only under way. Afterwards ``_course`` is the mean heading
        [rad].
        """
        self.phase, throttle, start, steady_at = "approach", self._steering.throttle, now.t, math.inf
        heading, speeds, last, due, at_speed = Steadiness(COURSE_WINDOW), Steadiness(), math.nan, -math.inf, False
        self._approach.start(now)
        self._heading_hold.start(now)
        while True:
            self._approach.update(now.t, now.value(self.signal), now.speed)
            heading.update(now.t, now.psi)
            speeds.update(now.t, now.speed)
            self._course = heading.mean
            if self._approach.done:
                if not throttle:
                    return now
                steady_at = min(steady_at, now.t)
                if now.t >= due:
                    change, last, due = abs(speeds.mean - last), speeds.mean, now.t + STEADY_WINDOW
                    self._approach.speed = last
                    at_speed = change <= STEADY_SPEED * last
                if now.t - start >= (2.0 * (steady_at - start) if at_speed else 2.0 * LONGEST_TIME):
                    return now
            now = yield self._command(self._heading_hold.steer(now) if throttle else 0.0, now)

    def _execute(self, phase: str, share: float, now: Observation) -> None:
        """Mark that the helm is put to *share* [fraction of full, positive to starboard] now."""
        self.phase = phase
        self._mark(now.t, "execute", {"N": share})

    def _held(self, share: float, now: Observation, least: float = 0.0) -> Part:
        """Hold the helm at *share* until the turn is steady, and then for as long again, at least *least* seconds.

        Afterwards ``_rates`` contains the times since the order [s] and the rates [rad/s].
        """
        steadiness, start, steady_at = Steadiness(), now.t, math.inf
        self._rates = []
        while now.t - start < LONGEST_HOLD:
            self._fastest = max(self._fastest, abs(now.r))
            steadiness.update(now.t, now.r)
            self._rates.append((now.t - start, now.r))
            if steady_at == math.inf and steadiness.is_within(STEADY_RATE * self._fastest):
                steady_at = now.t
            if now.t - start >= max(least, 2.0 * (steady_at - start)):
                break
            now = yield self._command(share, now)
        return now

    def _command(self, steering: float, now: Observation, throttle: float | None = None) -> Command:
        thrust = self._steering.throttle if throttle is None else throttle
        return hold(Actuate(X=thrust, N=steering), self._holds, now)
