"""The sequencer as ``tune`` and ``experiment`` steer by it: what must succeed, and the way back between two runs."""

from __future__ import annotations

import math
from collections.abc import Callable
from copy import deepcopy
from dataclasses import replace

from gcs_autotune.errors import AutotuneError, NotAchieved
from gcs_autotune.link import MavlinkCraft
from gcs_autotune.manoeuvres import Dive, Envelope, Flown, Manoeuvre, Sequencer
from gcs_autotune.trial import Trial
from gcs_autotune.watch import Watcher
from gcs_autotune.workflow.experiments import SHALLOW, turn_for
from gcs_autotune.workflow.interruption import Patience

__all__ = ["Helm"]


class Helm:
    """Flies manoeuvres aboard *craft* inside *envelope*; ``keep`` gets every record, as the sequencer's does.

    What a silence of up to *patience* [s] interrupts is flown again from its beginning, after a dive again where the
    craft has come up; *ask* whether a vehicle that was disarmed meanwhile may be armed again (never, by default).
    """

    def __init__(
        self,
        craft: MavlinkCraft,
        envelope: Envelope,
        watcher: Watcher,
        keep: Callable[[Trial], None],
        patience: float = 0.0,
        ask: Callable[[str], bool] = lambda question: False,
    ) -> None:
        self._craft = craft
        self._watcher = watcher
        self._patience = Patience(craft, patience, watcher.say, ask)
        self._dive: Dive | None = None
        self._envelope = envelope
        self._sequencer = Sequencer(craft, envelope, watcher, keep)

    def fly(self, manoeuvre: Manoeuvre, stage: str) -> Flown:
        """Fly *manoeuvre* and return it, however it ended; errors as those of the sequencer."""
        return self._fly(manoeuvre, stage, self._envelope)

    def bear(self, error: AutotuneError) -> bool:
        """Return whether *error* was a silence that is over, the craft neutral and ready to go on."""
        if not self._patience.bear(error):
            return False
        self._sequencer.go_on()
        return True

    def _fly(self, manoeuvre: Manoeuvre, stage: str, envelope: Envelope) -> Flown:
        again = deepcopy(manoeuvre)
        while True:
            try:
                return self._sequencer.fly(manoeuvre, stage, envelope)
            except AutotuneError as error:
                if not self.bear(error):
                    raise
                self._watcher.say(f"going on: {stage or again.name} is flown again from its beginning")
            self._come_down(again)
            manoeuvre = deepcopy(again)

    def _come_down(self, before: Manoeuvre) -> None:
        """Dive again *before* a manoeuvre that is flown at depth, where the craft has come up."""
        if self._dive is not None and not isinstance(before, Dive) and self._craft.observe().z < SHALLOW:
            self._sequencer.fly(deepcopy(self._dive), "diving")

    def achieve(self, manoeuvre: Manoeuvre, stage: str) -> Flown:
        """Fly *manoeuvre*, which must come to a good end.

        Raises
        ------
        NotAchieved
            It did not.
        """
        if isinstance(manoeuvre, Dive):
            self._dive = deepcopy(manoeuvre)
        flown = self.fly(manoeuvre, stage)
        if flown.outcome.ending == "aborted":
            raise NotAchieved(f"{stage}: {flown.outcome.reason}")
        return flown

    def come_about(self, throttle: float) -> None:
        """Turn a boat round, so that it does not run away in one direction; other craft stay where they are."""
        turn = turn_for(self._craft.firmware, throttle)
        if turn is not None:
            self._fly(turn, "turning about", replace(self._envelope, heading_excursion=math.inf))
