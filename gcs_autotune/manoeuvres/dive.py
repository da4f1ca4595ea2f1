"""Take an ROV down from the surface, where neither a depth relay nor a depth step can be flown."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from gcs_autotune.craft import DepthTarget, Observation
from gcs_autotune.manoeuvres.manoeuvre import Commands, Manoeuvre

__all__ = ["Dive", "DiveSettings"]

RAMP = 0.25
"""Rate of the depth reference [m/s], slow enough for an untuned loop. Project choice."""


@dataclass(frozen=True, slots=True)
class DiveSettings:
    """Settings of a dive to ``depth`` [m].

    The dive is complete once the depth is within ``band`` [m] for ``steady_time`` [s]. ``patience`` [s]: longest
    duration. An untuned loop may oscillate about the depth or hold another depth. Then it is sufficient to stay deeper
    than ``enough`` [m], and at most that much below ``depth``, for ``long`` [s].
    """

    depth: float
    band: float = 0.2
    steady_time: float = 2.0
    patience: float = 60.0
    enough: float = 1.0
    long: float = 15.0


class Dive(Manoeuvre):
    """Lowers the set-point of the autopilot's depth loop along a ramp and waits until the craft is at the final
    depth.
    """

    kind, purpose, in_manual = "dive", "transit", False

    def __init__(self, settings: DiveSettings) -> None:
        super().__init__(signal="z", force="Z")
        self._settings = settings

    @property
    def meta_fields(self) -> Mapping[str, Any]:
        """Depth [m] of the dive by name, for the trial's ``meta``."""
        return {"depth": self._settings.depth}

    def commands(self, now: Observation) -> Commands:
        """Yield depth commands that increase from the present depth, until the craft is at the final depth."""
        s, start, top = self._settings, now.t, now.z
        there_since = deep_since = start
        while True:
            elapsed = now.t - start
            self.target = min(s.depth, top + RAMP * elapsed)
            if not abs(now.z - s.depth) <= s.band:
                there_since = now.t
            if not s.enough <= now.z <= s.depth + s.enough:
                deep_since = now.t
            if now.t - there_since >= s.steady_time:
                self._end("completed", f"{now.z:.1f} m deep")
            elif elapsed > s.patience and now.t - deep_since >= s.long:
                self._end("completed", f"{now.z:.1f} m deep: deep enough, but the depth has not settled")
            elif elapsed > s.patience:
                self._end("aborted", self._why(now))
            now = yield DepthTarget(self.target)

    def _why(self, observation: Observation) -> str:
        s, z, output = self._settings, observation.z, observation.output.get("Z", math.nan)
        where = f"the craft is {z:.1f} m deep and did not reach {s.depth:g} m within {s.patience:g} s"
        if z > s.depth + s.band:
            cause = "Check its buoyancy, and lower the depth gains if the loop oscillates."
        else:
            where += f", with {output:+.2f} of full thrust down" if math.isfinite(output) else ""
            cause = "Check buoyancy, oscillation of the depth loop, and the direction of the vertical thrusters."
        return f"{where}. {cause} Or take the craft to this depth by hand and start there"
