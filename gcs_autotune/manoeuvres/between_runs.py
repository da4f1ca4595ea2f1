"""Between two runs of a plan: back to where the first began, and is the water calm?"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np

from gcs_autotune.craft import Actuate, Observation
from gcs_autotune.manoeuvres.manoeuvre import Commands, Manoeuvre
from gcs_autotune.trial import Purpose

__all__ = ["CalmCheck", "ComeBack"]

GAIN, DAMPING, MOST = 0.6, 0.3, 0.5
"""Chosen: steering per bearing error [1/rad] and per yaw rate [s/rad], and the most of it: damped while a boat's turn
rate at full rudder [rad/s] times its turning lag [s] stays below 3 or so."""
THERE = 5.0
"""Chosen [m]: so near it is back."""
LEAST_WAY = 0.3
"""Chosen [m/s]: a boat is given the time that the distance takes at this speed, ..."""
SPARE = 60.0
"""... and so many seconds for turning round."""


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
                self._end("stopped", "the vehicle tells no position, so it is left where it is")
            elif away <= THERE:
                self._end("completed", f"back, {away:.0f} m from where it began")
            elif now.t - start > patience:
                self._end("stopped", f"still {away:.0f} m from where it began after {patience:.0f} s")
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
                    f"the craft rolls or pitches by {math.degrees(rocking):.1f} deg (rms), and calm is up to "
                    f"{math.degrees(CALM):.0f} deg: wait for smaller waves, or take calm out of the plan",
                )
            now = yield Actuate()
