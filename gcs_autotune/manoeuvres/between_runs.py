"""Manoeuvres between two runs: return to the start, check for calm water, and come to rest."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np

from gcs_autotune.craft import Actuate, Observation
from gcs_autotune.manoeuvres.hold_controller import HELD_DURING, HoldController, hold
from gcs_autotune.manoeuvres.manoeuvre import Commands, Manoeuvre
from gcs_autotune.trial import Purpose

__all__ = ["CalmCheck", "ComeBack", "ComeToRest"]

GAIN, DAMPING, MOST = 0.6, 0.3, 0.5
"""Controller of the return: steering per bearing error [1/rad], steering per yaw rate [s/rad], and largest steering
[fraction of full]. Project choice.

The loop is damped while a boat's turn rate at full rudder [rad/s] times its turning lag [s] stays below about 3.
"""
THERE = 5.0
"""Distance [m] from the start at which a boat counts as returned. Project choice."""
LEAST_WAY = 0.3
"""Assumed speed of a boat [m/s] for the time limit of its return. Project choice."""
SPARE = 60.0
"""Additional time [s] for turning around, in the time limit of a return. Project choice."""


class ComeBack(Manoeuvre):
    """Steers a boat to its start (``x``, ``y`` [m]) at ``throttle`` with low gains, without the autopilot's own
    loop."""

    kind, purpose = "come-back", "transit"

    def __init__(self, x: float, y: float, throttle: float) -> None:
        super().__init__()
        self._x, self._y, self._throttle = x, y, throttle

    @property
    def meta_fields(self) -> Mapping[str, Any]:
        """Destination [m] and throttle by name, for the trial's ``meta``."""
        return {"x": self._x, "y": self._y, "throttle": self._throttle}

    def commands(self, now: Observation) -> Commands:
        """Yield the rudder that turns the bow towards the destination."""
        start, patience = now.t, SPARE
        while True:
            north, east = self._x - now.x, self._y - now.y
            away = math.hypot(north, east)
            patience = max(patience, SPARE + away / LEAST_WAY)
            if not math.isfinite(away):
                self._end("stopped", "the return was not flown: the vehicle reports no position")
            elif away <= THERE:
                self._end("completed", f"returned to {away:.0f} m from the start")
            elif now.t - start > patience:
                self._end("stopped", f"still {away:.0f} m from the start after {patience:.0f} s")
            error = math.remainder(math.atan2(east, north) - now.psi, 2.0 * math.pi)
            rate = now.r if math.isfinite(now.r) else 0.0
            steering = GAIN * error - DAMPING * rate if math.isfinite(error) else 0.0
            now = yield Actuate(X=self._throttle, N=max(-MOST, min(MOST, steering)))


CALM = math.radians(2.0)
"""Rms of roll and pitch [rad] up to which water counts as calm. Project choice."""
LOOK, WAIT = 5.0, 60.0
"""Time [s] over which the motion is evaluated, and the longest wait for calm water [s]. Project choice."""


class CalmCheck(Manoeuvre):
    """Waits without thrust until roll and pitch have been calm for a while; gives up after a minute."""

    kind = "calm-check"
    purpose: ClassVar[Purpose] = "check"

    def __init__(self) -> None:
        super().__init__(signal="phi")

    @property
    def meta_fields(self) -> Mapping[str, Any]:
        """Criterion for calm water by name, for the trial's ``meta``."""
        return {"calm": CALM}

    def commands(self, now: Observation) -> Commands:
        """Yield commands that keep every actuator neutral."""
        start = now.t
        seen: deque[tuple[float, float, float]] = deque()
        while True:
            seen.append((now.t, now.phi, now.theta))
            while seen[0][0] < now.t - LOOK:
                seen.popleft()
            rocking = float(np.max(np.std(np.array(seen)[:, 1:], axis=0)))
            if now.t - start >= LOOK and not rocking > CALM:
                self._end("completed", f"calm: {math.degrees(rocking):.1f} deg of roll and pitch")
            elif now.t - start > WAIT:
                self._end(
                    "aborted",
                    f"roll and pitch motion is {math.degrees(rocking):.1f} deg (rms), above the limit of "
                    f"{math.degrees(CALM):.0f} deg. Wait for smaller waves, or remove calm from the plan",
                )
            now = yield Actuate()


STILL = math.radians(2.0), 0.05
"""Rms turn rate [rad/s] and climb rate [m/s] up to which a craft counts as still. Project choice."""
STILL_FOR, REST = 1.0, 20.0
"""Time [s] for which the craft must be still, and the longest wait for it [s]. Project choice."""


class ComeToRest(Manoeuvre):
    """Holds heading and depth of an ROV with low gains until it is still, or for :data:`REST`.

    The autopilot's loop takes over next. If the craft still turned after an experiment, the loop's integral would build
    up while it stops the turn. With little drag the integral would take half a minute to decay.

    ``signal`` and ``force`` are those of the next step, for display.
    """

    kind, purpose = "come-to-rest", "transit"

    def __init__(self, signal: str = "psi", force: str = "N") -> None:
        super().__init__(signal=signal, force=force)
        self._holds = [HoldController(gains) for gains in HELD_DURING["x"]]

    @property
    def meta_fields(self) -> Mapping[str, Any]:
        """Criterion for a craft at rest by name, for the trial's ``meta``."""
        return {"still": list(STILL)}

    def commands(self, now: Observation) -> Commands:
        """Yield the commands that hold heading and depth."""
        start = now.t
        seen: deque[tuple[float, float, float]] = deque()
        while True:
            seen.append((now.t, now.r, now.w))
            while seen[0][0] < now.t - STILL_FOR:
                seen.popleft()
            # not at every reading: held by a hand whose thrusters have a dead band, it oscillates about rest for ever
            rms = np.sqrt(np.mean(np.square(np.array(seen)[:, 1:]), axis=0))
            if now.t - start >= STILL_FOR and not np.any(rms > STILL):
                self._end("completed", "at rest")
            elif now.t - start >= REST:
                self._end("completed", f"waited {REST:.0f} s, the craft still moves")
            now = yield hold(Actuate(), self._holds, now)
