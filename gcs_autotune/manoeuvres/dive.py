"""Taking an ROV down from the surface, where neither a depth relay nor a depth step can be flown."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from gcs_autotune.craft import Command, DepthTarget, Observation
from gcs_autotune.manoeuvres.manoeuvre import Outcome
from gcs_autotune.trial import Mark
from gcs_autotune.watch import Progress

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


class Dive:
    """Leads the autopilot's depth loop down a ramp and waits until it is there."""

    name = "dive"
    in_manual = False

    def __init__(self, settings: DiveSettings) -> None:
        self.outcome: Outcome | None = None
        self._settings = settings
        self._start = self._from = self._target = self._there_since = self._deep_since = math.nan

    @property
    def settings(self) -> Mapping[str, Any]:
        """The settings, for the trial's meta."""
        return {"manoeuvre": "dive", "purpose": "transit", "depth": self._settings.depth}

    def start(self, observation: Observation) -> None:
        """Begin at the present depth."""
        self._start = self._there_since = self._deep_since = observation.t
        self._from = self._target = observation.z

    def update(self, observation: Observation) -> Command:
        """Lower the wanted depth; look whether the craft has come down."""
        s, elapsed = self._settings, observation.t - self._start
        self._target = min(s.depth, self._from + RAMP * elapsed)
        if not abs(observation.z - s.depth) <= s.band:
            self._there_since = observation.t
        if not s.enough <= observation.z <= s.depth + s.enough:
            self._deep_since = observation.t
        if observation.t - self._there_since >= s.steady_time:
            self.outcome = Outcome("completed", f"{observation.z:.1f} m deep")
        elif elapsed > s.patience and observation.t - self._deep_since >= s.long:
            self.outcome = Outcome("completed", f"{observation.z:.1f} m deep: deep enough, though it does not settle")
        elif elapsed > s.patience:
            self.outcome = Outcome("aborted", self._why(observation))
        return DepthTarget(self._target)

    def _why(self, observation: Observation) -> str:
        s, z, output = self._settings, observation.z, observation.output.get("Z", math.nan)
        where = f"the craft is {z:.1f} m deep and does not come to {s.depth:g} m within {s.patience:g} s"
        if z > s.depth + s.band:
            cause = "does it sink by itself, or does its depth loop swing (lower its gains)?"
        else:
            where += f", with {output:+.2f} of full thrust down" if math.isfinite(output) else ""
            cause = "is it too buoyant, does its depth loop swing, or are the vertical thrusters reversed?"
        return f"{where}: {cause} Take it to that depth by hand and start again there"

    def take_marks(self) -> Sequence[Mark]:
        """Nothing to mark."""
        return ()

    def progress(self, observation: Observation) -> Progress:
        """Return depth against target."""
        return Progress(
            stage="",
            manoeuvre="dive",
            t=observation.t,
            signal="z",
            value=observation.z,
            target=self._target,
            output=observation.output.get("Z", math.nan),
            age=observation.age,
        )
