"""A light hand on a boat's rudder: keeps the course while something else is being measured.

The boat's own heading loop cannot do it, for the throttle is ours (MANUAL) and its gains may be what is wrong.
"""

from __future__ import annotations

import math

from gcs_autotune.craft import Observation

__all__ = ["CourseHand"]

GAIN = 0.2
"""Chosen: steering per heading error [1/rad] at 1 m/s; above that it is divided by the speed, as rudders bite with it.
Proportional alone: with a turning lag T and a turn rate K at full rudder it is damped while ``GAIN K T`` < 1/2 or so,
which leaves room for boats of K = 0.6 rad/s and T = 4 s."""
MOST = 0.4
CALM = 0.5
"""Every swing through zero that is not clearly smaller than the one before takes this share of the gain ..."""
LEAST = 0.1
"""... down to this share of :data:`GAIN`."""
NOTED = math.radians(5.0)
"""Swings smaller than this do no harm."""


class CourseHand:
    """Holds the heading found at the first observation; gentler whenever it finds itself swinging."""

    def __init__(self) -> None:
        self._reference = math.nan
        self._share = 1.0
        self._side = 0.0
        self._peak = self._last_peak = 0.0

    def start(self, observation: Observation) -> None:
        """Take the present heading as the course."""
        self._reference = observation.psi

    def steer(self, observation: Observation) -> float:
        """Return the steering to apply now, fraction of full, to starboard."""
        error = self._reference - observation.psi
        if not math.isfinite(error):
            return 0.0
        self._notice(error)
        speed = observation.speed if math.isfinite(observation.speed) else 1.0
        wanted = self._share * GAIN * error / max(speed, 1.0)
        return max(-MOST, min(MOST, wanted))

    def _notice(self, error: float) -> None:
        if error * self._side < 0.0:
            if self._peak > NOTED and self._peak > 0.8 * self._last_peak > 0.0:
                self._share = max(CALM * self._share, LEAST)
            self._last_peak, self._peak = self._peak, 0.0
        self._side = math.copysign(1.0, error) if error else self._side
        self._peak = max(self._peak, abs(error))
