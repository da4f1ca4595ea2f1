"""Between two runs: back to where the first began, is the water calm, does the craft lie still?"""

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
"""Chosen: steering per bearing error [1/rad] and per yaw rate [s/rad], and the most of it: damped while a boat's turn
rate at full rudder [rad/s] times its turning lag [s] stays below 3 or so."""
THERE = 5.0
"""Chosen [m]: so near it is back."""
LEAST_WAY = 0.3
"""Assumed speed of a boat for the time limit of its return [m/s]. Chosen."""
SPARE = 60.0
"""Additional seconds for turning around. Chosen."""


class ComeBack(Manoeuvre):
    """Steers a boat to where it began (``x``, ``y`` [m]) at ``throttle``, with a light hand and no loop of its own."""

    kind, purpose = "come-back", "transit"

    def __init__(self, x: float, y: float, throttle: float) -> None:
        super().__init__()
        self._x, self._y, self._throttle = x, y, throttle

    @property
    def asked(self) -> Mapping[str, Any]:
        """Where to and at what throttle."""
        return {"x": self._x, "y": self._y, "throttle": self._throttle}

    def commands(self, now: Observation) -> Commands:
        """Yield the rudder that turns the bow towards the place."""
        start, patience = now.t, SPARE
        while True:
            north, east = self._x - now.x, self._y - now.y
            away = math.hypot(north, east)
            patience = max(patience, SPARE + away / LEAST_WAY)
            if not math.isfinite(away):
                self._end("stopped", "not moved: the vehicle reports no position")
            elif away <= THERE:
                self._end("completed", f"back, {away:.0f} m from the start")
            elif now.t - start > patience:
                self._end("stopped", f"still {away:.0f} m from the start after {patience:.0f} s")
            error = math.remainder(math.atan2(east, north) - now.psi, 2.0 * math.pi)
            rate = now.r if math.isfinite(now.r) else 0.0
            steering = GAIN * error - DAMPING * rate if math.isfinite(error) else 0.0
            now = yield Actuate(X=self._throttle, N=max(-MOST, min(MOST, steering)))


CALM = math.radians(2.0)
"""Chosen [rad]: rms of roll and of pitch up to which water counts as calm."""
LOOK, WAIT = 5.0, 60.0
"""Chosen [s]: how long it is looked at, and waited for."""


class CalmCheck(Manoeuvre):
    """Looks, thrust off, until roll and pitch have been calm for a while; gives up after a minute."""

    kind = "calm-check"
    purpose: ClassVar[Purpose] = "check"

    def __init__(self) -> None:
        super().__init__(signal="phi")

    @property
    def asked(self) -> Mapping[str, Any]:
        """What counts as calm."""
        return {"calm": CALM}

    def commands(self, now: Observation) -> Commands:
        """Yield nothing to any actuator."""
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
"""Chosen [rad/s, m/s]: a craft that turns and climbs no faster (rms) lies still, ..."""
STILL_FOR, REST = 1.0, 20.0
"""... for so long, and is waited for so long [s]."""


class ComeToRest(Manoeuvre):
    """Holds heading and depth of an ROV by a light hand until it lies still, or for :data:`REST`.

    Its own loop, which takes over next, fills its integral while it catches a craft that still turns from an
    experiment, and keeps that for as long as it works off a constant force: half a minute where there is little drag.

    ``signal`` and ``force`` are those of the step that is next: what people watch.
    """

    kind, purpose = "come-to-rest", "transit"

    def __init__(self, signal: str = "psi", force: str = "N") -> None:
        super().__init__(signal=signal, force=force)
        self._holds = [HoldController(gains) for gains in HELD_DURING["x"]]

    @property
    def asked(self) -> Mapping[str, Any]:
        """What counts as still."""
        return {"still": list(STILL)}

    def commands(self, now: Observation) -> Commands:
        """Yield what holds the craft."""
        start = now.t
        seen: deque[tuple[float, float, float]] = deque()
        while True:
            seen.append((now.t, now.r, now.w))
            while seen[0][0] < now.t - STILL_FOR:
                seen.popleft()
            # not at every reading: held by a hand whose thrusters have a dead band, it swings about rest for ever
            rms = np.sqrt(np.mean(np.square(np.array(seen)[:, 1:]), axis=0))
            if now.t - start >= STILL_FOR and not np.any(rms > STILL):
                self._end("completed", "at rest")
            elif now.t - start >= REST:
                self._end("completed", f"not at rest after {REST:.0f} s")
            now = yield hold(Actuate(), self._holds, now)
