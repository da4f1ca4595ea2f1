"""Turning a boat round between two experiments, so that it comes back to where it started from."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from gcs_autotune.craft import Actuate, Command, Observation
from gcs_autotune.manoeuvres.manoeuvre import Outcome
from gcs_autotune.trial import Mark
from gcs_autotune.watch import Progress

__all__ = ["TurnAbout", "TurnAboutSettings"]


@dataclass(frozen=True, slots=True)
class TurnAboutSettings:
    """Constant rudder until the bow has come round by ``angle`` [rad].

    ``output`` steering and ``throttle`` are fractions of full; a positive output turns to starboard. ``patience``
    [s] is the longest time it may take.
    """

    throttle: float
    output: float = 0.5
    angle: float = math.radians(165.0)
    patience: float = 120.0


class TurnAbout:
    """Needs no control loop, so it works whatever the present gains are. Ends when the bow has come round."""

    name = "turn-about"
    in_manual = True

    def __init__(self, settings: TurnAboutSettings) -> None:
        self.outcome: Outcome | None = None
        self._settings = settings
        self._psi = self._t = math.nan

    @property
    def settings(self) -> Mapping[str, Any]:
        """The settings, for the trial's meta."""
        s = self._settings
        return {
            "manoeuvre": "turn-about",
            "purpose": "transit",
            "throttle": s.throttle,
            "output": s.output,
            "angle": s.angle,
        }

    def start(self, observation: Observation) -> None:
        """Take the present heading as the one to turn from."""
        self._psi, self._t = observation.psi, observation.t

    def update(self, observation: Observation) -> Command:
        """Hold the rudder until the bow has come round."""
        s = self._settings
        if abs(observation.psi - self._psi) >= s.angle:
            self.outcome = Outcome("completed", "turned about")
        elif observation.t - self._t > s.patience:
            self.outcome = Outcome(
                "stopped", f"turned only {math.degrees(abs(observation.psi - self._psi)):.0f} deg in {s.patience:.0f} s"
            )
        return Actuate(X=s.throttle, N=s.output)

    def take_marks(self) -> Sequence[Mark]:
        """Nothing to mark."""
        return ()

    def progress(self, observation: Observation) -> Progress:
        """Return how far it has come round."""
        return Progress(
            stage="",
            manoeuvre="turn-about",
            t=observation.t,
            signal="psi",
            value=observation.psi,
            output=observation.output.get("N", math.nan),
            age=observation.age,
        )
