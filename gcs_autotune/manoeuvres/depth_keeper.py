"""Keeping an ROV near its depth while its heading swings: in manual mode nobody else does."""

from __future__ import annotations

import math

from gcs_autotune.craft import Observation

__all__ = ["DepthKeeper"]

P, D, I = 0.4, 0.4, 0.03
"""Chosen: fraction of full thrust per m, per m/s, per m s. Slow and well damped on craft that full thrust
accelerates at 0.3 to 5 m/s^2; a pilot's gentle hand, not a depth loop."""
MOST = 0.5
"""Largest thrust it uses, fraction of full."""


class DepthKeeper:
    """Gentle PID on depth about the depth at which it was started; idle when depth is unknown."""

    def __init__(self) -> None:
        self._reference = math.nan
        self._t = math.nan
        self._integral = 0.0

    def thrust(self, observation: Observation) -> float:
        """Return the heave demand, fraction of full output, down positive."""
        z, w = observation.z, observation.w
        if not math.isfinite(z):
            return 0.0
        if math.isnan(self._reference):
            self._reference, self._t = z, observation.t
        error = self._reference - z
        self._integral += I * error * (observation.t - self._t)
        self._integral = max(-MOST, min(MOST, self._integral))
        self._t = observation.t
        demand = P * error - (D * w if math.isfinite(w) else 0.0) + self._integral
        return max(-MOST, min(MOST, demand))
