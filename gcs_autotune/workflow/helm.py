"""The sequencer as ``tune`` and ``experiment`` steer by it: what must succeed, and the way back between two runs."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

from gcs_autotune.errors import NotAchieved
from gcs_autotune.link import MavlinkCraft
from gcs_autotune.manoeuvres import Envelope, Flown, Manoeuvre, Sequencer
from gcs_autotune.trial import Trial
from gcs_autotune.watch import Watcher
from gcs_autotune.workflow.experiments import turn_for

__all__ = ["Helm"]


class Helm:
    """Flies manoeuvres aboard *craft* inside *envelope*; ``keep`` gets every record, as the sequencer's does."""

    def __init__(
        self, craft: MavlinkCraft, envelope: Envelope, watcher: Watcher, keep: Callable[[Trial], None]
    ) -> None:
        self._kind = craft.firmware.kind
        self._envelope = envelope
        self._sequencer = Sequencer(craft, envelope, watcher, keep)

    def fly(self, manoeuvre: Manoeuvre, stage: str) -> Flown:
        """Fly *manoeuvre* and return it, however it ended; errors as those of the sequencer."""
        return self._sequencer.fly(manoeuvre, stage)

    def achieve(self, manoeuvre: Manoeuvre, stage: str) -> Flown:
        """Fly *manoeuvre*, which must come to a good end.

        Raises
        ------
        NotAchieved
            It did not.
        """
        flown = self.fly(manoeuvre, stage)
        if flown.outcome.ending == "aborted":
            raise NotAchieved(f"{stage}: {flown.outcome.reason}")
        return flown

    def come_about(self, throttle: float) -> None:
        """Turn a boat round, so that it does not run away in one direction; other craft stay where they are."""
        turn = turn_for(self._kind, throttle)
        if turn is not None:
            self._sequencer.fly(turn, "turning about", replace(self._envelope, heading_excursion=math.inf))
