"""A step in position, and holding against a push, both under the autopilot's own position loop.

Nothing on board can push a craft sideways while its autopilot holds a position, except its own thrusters. ArduSub adds
the sticks to the output of POSHOLD, and moves the held position only beyond a tenth of their range. So a stick just
below a tenth is a push of a known size.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any

from gcs_autotune.craft import Actuate, Command, Observation, PositionTarget
from gcs_autotune.firmware import Firmware
from gcs_autotune.manoeuvres.manoeuvre import Commands, Manoeuvre

__all__ = ["PUSH", "PushPosition", "StepPosition"]

PUSH = 0.09
"""Stick of the push [fraction of full]: ArduSub moves the held position beyond 0.1 (``ArduSub/mode_poshold``)."""
JUMP = 0.5
"""Change of the position between two observations that no craft makes [m], beyond its speed. Project choice: 15
standard deviations of a filtered position."""
SPEEDING = 2.0
"""Allowed speed between two observations, relative to the reported one. Project choice."""
DIVERGED, LEAST_ROOM = 2.5, 2.0
"""Distance from the target at which the loop counts as unstable: multiple of the step beyond it, and at least [m].
Project choice."""
SATURATED = 0.9
"""Largest output that counts as saturated, as :data:`gcs_autotune.workflow.hold.RANGE`."""
REPEATS = 5
"""Number of observations for which a boat is sent a new position. Project choice: each message restarts ArduRover's
approach, and several are lost less often than one."""

ADRIFT = "the reported position drifts (GPS or DVL lost)"
"""Other cause of a distance from the target: an autopilot without GPS or DVL goes on reporting for seconds."""


class _AtPosition(Manoeuvre):
    """What both have in common: the checks of the position, and the phases."""

    purpose, in_manual = "proof", False

    def __init__(self, name: str, size: float) -> None:
        super().__init__(name)  # a live line shows the heading: one number cannot show a position
        self._size = size
        self._last: Observation | None = None

    def _check(self, now: Observation, x: float, y: float) -> None:
        """End the manoeuvre if the position is unknown, jumps, or is far from (x, y) [m]."""
        last, self._last = self._last, now
        if not all(math.isfinite(value) for value in (now.x, now.y, now.psi)):
            self._end("aborted", "the vehicle reports no usable position any more. Check its position sensor")
            return
        if last is not None:
            jump = math.hypot(now.x - last.x, now.y - last.y)
            speed = now.speed if math.isfinite(now.speed) else 0.0
            if jump > JUMP + SPEEDING * speed * max(now.t - last.t, 0.0):
                self._end(
                    "aborted",
                    f"the position jumped by {jump:.1f} m (a reset of the estimator). Check the position sensor and "
                    "start again",
                )
                return
        away, most = math.hypot(now.x - x, now.y - y), max((1.0 + DIVERGED) * self._size, LEAST_ROOM)
        if away > most:
            used = max(abs(now.output.get(force, 0.0)) for force in "XY")
            if used >= SATURATED:
                self._end(
                    "aborted",
                    f"the craft is {away:.1f} m from its target at {used:.0%} of full output: the current is stronger "
                    f"than the craft, or {ADRIFT}. Check both, or wait for slack water",
                )
            else:
                self._end("stopped", f"the craft is {away:.1f} m from its target: the loop is unstable, or {ADRIFT}")

    def _phase_of(self, now: Observation, until: float, legs: Iterator[tuple[str, float, Any]]) -> tuple[float, Any]:
        """Return the end [s] of the phase at *now* and its content; the manoeuvre ends after the last one."""
        name, seconds, content = next(legs, ("", 0.0, None))
        if name:
            self.phase = name
            return now.t + seconds, content
        self._end("completed", "all phases flown")
        return until, None


class StepPosition(_AtPosition):
    """Hold the position, step by *size* [m] ahead and to starboard at once, and back. Marks ``target`` give x and y.

    Parameters
    ----------
    settle, duration : time at the first position, and at each later one [s].
    once : whether each position is sent only briefly (ArduRover, which would restart its approach).
    abeam : step to starboard relative to that ahead.
    """

    kind = "step-position"

    def __init__(
        self, size: float, settle: float, duration: float, name: str, *, once: bool = False, abeam: float = 1.0
    ) -> None:
        super().__init__(name, size)
        self._settle, self._duration = settle, duration
        self._once, self._abeam = once, abeam

    def mode_of(self, firmware: Firmware) -> str:
        """Return the mode that goes to commanded positions."""
        return firmware.position_mode

    @property
    def meta_fields(self) -> Mapping[str, Any]:
        """Step and durations."""
        return {"size": self._size, "abeam": self._abeam, "settle": self._settle, "duration": self._duration}

    def commands(self, now: Observation) -> Commands:
        """Yield the position at the start, the step, and the start again."""
        s, c = math.sin(now.psi), math.cos(now.psi)
        away = self._size * (c - self._abeam * s), self._size * (s + self._abeam * c)
        base = PositionTarget(now.x, now.y, now.z if math.isfinite(now.z) else 0.0, now.psi)
        there = PositionTarget(now.x + away[0], now.y + away[1], base.z, base.psi)
        legs = iter((("hold", self._settle, base), ("step", self._duration, there), ("back", self._duration, base)))
        target, until, sent = base, now.t, 0
        while True:
            if now.t >= until:
                until, content = self._phase_of(now, until, legs)
                if content is not None:
                    target, sent = content, 0
                    self._mark(now.t, "target", {"x": target.x, "y": target.y, "phase": self.phase})
            self._check(now, target.x, target.y)
            sent += 1
            now = yield self._command(target, sent)

    def _command(self, target: PositionTarget, sent: int) -> Command:
        waits = self._once and (self.phase == "hold" or sent > REPEATS)  # in the mode's own way of staying
        return Actuate() if waits else target


class PushPosition(_AtPosition):
    """Let the autopilot hold the position, and push with the sticks: ahead, then to starboard, with a rest after each.

    Marks ``push`` give the phase, and x and y at the start.

    Parameters
    ----------
    settle, duration : time before the first push; of each push, and of the rest after it [s].
    """

    kind = "push-position"

    def __init__(self, settle: float, duration: float, name: str) -> None:
        super().__init__(name, 0.0)
        self._settle, self._duration = settle, duration

    def mode_of(self, firmware: Firmware) -> str:
        """Return the mode in which the sticks push."""
        return firmware.push_mode

    @property
    def meta_fields(self) -> Mapping[str, Any]:
        """Push and durations."""
        return {"push": PUSH, "settle": self._settle, "duration": self._duration}

    def commands(self, now: Observation) -> Commands:
        """Yield neutral sticks and the pushes in turn."""
        rest, seconds, x, y = Actuate(), self._duration, now.x, now.y
        legs = iter(
            (
                ("hold", self._settle, rest),
                ("push ahead", seconds, Actuate(X=PUSH)),
                ("rest", seconds, rest),
                ("push to starboard", seconds, Actuate(Y=PUSH)),
                ("rest", seconds, rest),
            )
        )
        command, until = rest, now.t
        while True:
            if now.t >= until:
                until, content = self._phase_of(now, until, legs)
                if content is not None:
                    command = content
                    self._mark(now.t, "push", {"x": now.x, "y": now.y, "phase": self.phase})
            self._check(now, x, y)
            now = yield command
