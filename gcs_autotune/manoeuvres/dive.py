"""Taking an ROV down from the surface, where neither a depth relay nor a depth step can be flown."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from gcs_autotune.craft import DepthTarget, Observation
from gcs_autotune.manoeuvres.manoeuvre import Commands, Manoeuvre

__all__ = ["Dive", "DiveSettings"]

RAMP = 0.25
"""Chosen [m/s]: how fast the wanted depth goes down; gentle enough for a loop that is still to be tuned."""


@dataclass(frozen=True, slots=True)
class DiveSettings:
    """Go to ``depth`` [m] and be within ``band`` [m] of it for ``steady_time`` [s], in ``patience`` [s] at most.

    A loop that is still to be tuned may swing about the depth, or hold another: by then it is enough to have been
    deeper than ``enough`` [m], and not deeper than wanted by more than as much, for ``long`` [s].
    """

    depth: float
    band: float = 0.2
    steady_time: float = 2.0
    patience: float = 60.0
    enough: float = 1.0
    long: float = 15.0


class Dive(Manoeuvre):
    """Leads the autopilot's depth loop down a ramp and waits until it is there."""

    kind, purpose, in_manual = "dive", "transit", False

    def __init__(self, settings: DiveSettings) -> None:
        super().__init__(signal="z", force="Z")
        self._settings = settings

    @property
    def asked(self) -> Mapping[str, Any]:
        """The depth."""
        return {"depth": self._settings.depth}

    def commands(self, now: Observation) -> Commands:
        """Yield a depth that goes down from the present one; look whether the craft has come down."""
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
                self._end("completed", f"{now.z:.1f} m deep: deep enough, though it does not settle")
            elif elapsed > s.patience:
                self._end("aborted", self._why(now))
            now = yield DepthTarget(self.target)

    def _why(self, observation: Observation) -> str:
        s, z, output = self._settings, observation.z, observation.output.get("Z", math.nan)
        where = f"the craft is {z:.1f} m deep and does not come to {s.depth:g} m within {s.patience:g} s"
        if z > s.depth + s.band:
            cause = "does it sink by itself, or does its depth loop swing (lower its gains)?"
        else:
            where += f", with {output:+.2f} of full thrust down" if math.isfinite(output) else ""
            cause = "is it too buoyant, does its depth loop swing, or are the vertical thrusters reversed?"
        return f"{where}: {cause} Take it to that depth by hand and start again there"
