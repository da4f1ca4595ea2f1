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
    """Go to ``depth`` [m] and be within ``band`` [m] of it for ``steady_time`` [s], in ``patience`` [s] at most."""

    depth: float
    band: float = 0.2
    steady_time: float = 2.0
    patience: float = 60.0


class Dive:
    """Leads the autopilot's depth loop down a ramp and waits until it is there."""

    name = "dive"
    in_manual = False

    def __init__(self, settings: DiveSettings) -> None:
        self.outcome: Outcome | None = None
        self._settings = settings
        self._start = self._from = self._target = self._there_since = math.nan

    @property
    def settings(self) -> Mapping[str, Any]:
        """The settings, for the trial's meta."""
        return {"manoeuvre": "dive", "purpose": "transit", "depth": self._settings.depth}

    def start(self, observation: Observation) -> None:
        """Begin at the present depth."""
        self._start = self._there_since = observation.t
        self._from = self._target = observation.z

    def update(self, observation: Observation) -> Command:
        """Lower the wanted depth; look whether the craft has come down."""
        s, elapsed = self._settings, observation.t - self._start
        self._target = min(s.depth, self._from + RAMP * elapsed)
        if not abs(observation.z - s.depth) <= s.band:
            self._there_since = observation.t
        if observation.t - self._there_since >= s.steady_time:
            self.outcome = Outcome("completed", f"{observation.z:.1f} m deep")
        elif elapsed > s.patience:
            self.outcome = Outcome(
                "aborted",
                f"the craft is {observation.z:.1f} m deep and does not come to {s.depth:g} m within {s.patience:g} s: "
                "is it too buoyant, or the vertical thrusters reversed? Take it down by hand and start again there",
            )
        return DepthTarget(self._target)

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
