"""Turn a boat around between two experiments, so that it returns towards its start."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from gcs_autotune.craft import Actuate, Observation
from gcs_autotune.manoeuvres.manoeuvre import Commands, Manoeuvre

__all__ = ["TurnAround", "TurnAroundSettings"]


@dataclass(frozen=True, slots=True)
class TurnAroundSettings:
    """Settings: constant rudder until the heading has changed by ``angle`` [rad].

    ``output`` steering and ``throttle`` are fractions of full; a positive output turns to starboard. ``patience`` [s]
    is the longest permitted duration.
    """

    throttle: float
    output: float = 0.5
    angle: float = math.radians(165.0)
    patience: float = 120.0


class TurnAround(Manoeuvre):
    """Turns a boat around with constant rudder, without a control loop, so that it does not depend on the
    present gains.
    """

    kind, purpose = "turn-around", "transit"

    def __init__(self, settings: TurnAroundSettings) -> None:
        super().__init__()
        self._settings = settings

    @property
    def meta_fields(self) -> Mapping[str, Any]:
        """Throttle, steering and angle [rad] by name, for the trial's ``meta``."""
        s = self._settings
        return {"throttle": s.throttle, "output": s.output, "angle": s.angle}

    def commands(self, now: Observation) -> Commands:
        """Yield commands with a constant rudder until the heading has changed by the required angle."""
        s, psi, start = self._settings, now.psi, now.t
        while True:
            turned = abs(now.psi - psi)
            if turned >= s.angle:
                self._end("completed", "turned around")
            elif now.t - start > s.patience:
                self._end("stopped", f"turned only {math.degrees(turned):.0f} deg in {s.patience:.0f} s")
            now = yield Actuate(X=s.throttle, N=s.output)
