"""Keeping an ROV's depth while its heading swings, or its heading while its depth does.

In manual mode nobody else does.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from gcs_autotune.craft import Observation

__all__ = ["HOLDERS", "KEEPERS", "Keeper", "KeeperGains"]


@dataclass(frozen=True, slots=True)
class KeeperGains:
    """Gentle PID on one signal: which, its rate, the force it drives, gains in fractions of full output.

    Chosen as a pilot's light hand, not a control loop: slow and well damped on craft that full output accelerates
    at 0.3 to 5 m/s^2 or rad/s^2. ``most`` is the largest output it uses.
    """

    signal: str
    rate: str
    force: str
    P: float = 0.4
    I: float = 0.03  # noqa: E741 - the integral gain's own name
    D: float = 0.4
    most: float = 0.5


_DEPTH = KeeperGains("z", "w", "Z")
_HEADING = KeeperGains("psi", "r", "N")

KEEPERS: Mapping[str, tuple[KeeperGains, ...]] = {"psi": (_DEPTH,), "z": (_HEADING,), "x": (_HEADING, _DEPTH)}
"""Signal that is being swung -> what is kept meanwhile."""
HOLDERS: Mapping[str, KeeperGains] = {"z": _DEPTH}
"""Signal that is going to be swung -> how it is held until then: with neutral outputs a buoyant craft would be at the
surface, where it can swing one way only."""


class Keeper:
    """Holds the value found at the first observation; idle while the signal is unknown."""

    def __init__(self, gains: KeeperGains) -> None:
        self._gains = gains
        self._reference = math.nan
        self._t = math.nan
        self._integral = 0.0

    @property
    def force(self) -> str:
        """The force it drives."""
        return self._gains.force

    def demand(self, observation: Observation) -> float:
        """Return the output to apply now, fraction of full."""
        g = self._gains
        x, rate = observation.value(g.signal), observation.value(g.rate)
        if not math.isfinite(x):
            return 0.0
        if math.isnan(self._reference):
            self._reference, self._t = x, observation.t
        error = self._reference - x
        self._integral += g.I * error * (observation.t - self._t)
        self._integral = max(-g.most, min(g.most, self._integral))
        self._t = observation.t
        wanted = g.P * error - (g.D * rate if math.isfinite(rate) else 0.0) + self._integral
        return max(-g.most, min(g.most, wanted))
