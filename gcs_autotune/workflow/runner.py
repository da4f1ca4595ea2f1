"""Manoeuvres as jobs fly them: what must succeed, the way back between two, and silences that are waited out.

A vehicle's failsafes may have disarmed it and changed its mode during a silence; so may somebody beside it, whom
nobody heard. What we had armed, as announced, is armed again after asking; what was found armed is not. A vehicle
that has restarted is another story: its estimator and message rates are gone.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import suppress
from copy import deepcopy
from dataclasses import replace

from gcs_autotune.axes import AxisKind
from gcs_autotune.errors import AutotuneError, GuardTripped, LinkLost, NotAchieved
from gcs_autotune.link import MavlinkCraft
from gcs_autotune.manoeuvres import (
    ComeToRest,
    Dive,
    Envelope,
    Flown,
    Manoeuvre,
    Sequencer,
    TurnAbout,
    TurnAboutSettings,
    far_out,
)
from gcs_autotune.trial import Trial
from gcs_autotune.watch import Watcher
from gcs_autotune.workflow.experiments import SHALLOW

__all__ = ["MOST", "ManoeuvreRunner", "Patience"]


class ManoeuvreRunner:
    """Flies manoeuvres on *craft* inside *envelope*; ``keep`` gets every record, as the sequencer's does.

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

    def fly(self, manoeuvre: Manoeuvre, stage: str, envelope: Envelope | None = None) -> Flown:
        """Fly *manoeuvre*, which must come to a good end; errors as those of the sequencer.

        Raises
        ------
        NotAchieved
            It did not.
        """
        if isinstance(manoeuvre, Dive):
            self._dive = deepcopy(manoeuvre)
        flown = self.attempt(manoeuvre, stage, envelope)
        if flown.outcome.ending == "aborted":
            raise NotAchieved(f"{stage}: {flown.outcome.reason}")
        return flown

    def attempt(self, manoeuvre: Manoeuvre, stage: str, envelope: Envelope | None = None) -> Flown:
        """Fly *manoeuvre* and return it, however it ended; one that a silence interrupts is flown again."""
        again = deepcopy(manoeuvre)
        while True:
            try:
                return self._sequencer.fly(manoeuvre, stage, envelope or self._envelope)
            except AutotuneError as error:
                if not self.bear(error):
                    raise
                self._watcher.say(f"going on: {stage or again.name} is flown again from its beginning")
            self._come_down(again)
            manoeuvre = deepcopy(again)

    def bear(self, error: AutotuneError) -> bool:
        """Return whether *error* was a silence that is over, the craft neutral and ready to go on."""
        if not self._patience.bear(error):
            return False
        self._sequencer.go_on()
        return True

    def _come_down(self, before: Manoeuvre) -> None:
        """Dive again *before* a manoeuvre that is flown at depth, where the craft has come up."""
        if self._dive is not None and not isinstance(before, Dive) and self._craft.observe().z < SHALLOW:
            self._sequencer.fly(deepcopy(self._dive), "diving")

    def come_about(self, throttle: float, ahead: float = math.inf, *, last: bool = False) -> bool:
        """Turn a boat round when the room asks for it, and return whether; other craft stay where they are.

        It turns to the side where it began: the other one takes more room.

        ahead : how long [s] what comes next takes; infinite: turn in any case. last : nothing comes after that.
        """
        if not self._craft.firmware.needs_way:
            return False
        now = self._craft.observe()
        if not far_out(self._envelope, self._sequencer.away(now), ahead, last=last):
            return False
        turn = TurnAboutSettings(throttle)
        turn = replace(turn, output=self._sequencer.home_side(now) * turn.output)
        self.attempt(TurnAbout(turn), "turning about", replace(self._envelope, heading_excursion=math.inf))
        return True

    def come_to_rest(self, stage: str, axis: AxisKind) -> None:
        """Bring a craft that can stay where it is to rest, as the beginning of *stage*, a step of *axis*.

        A boat floats on.
        """
        if not self._craft.firmware.floats:
            self.attempt(ComeToRest(axis.stepped, axis.excitation.names.force), stage)


MOST = 5
"""Chosen: interruptions borne in one run; a link that breaks more often is no link to tune over."""
_TELLING = 1.5
"""Chosen [s]: a silence that a vehicle's failsafes may have acted on."""
_LATELY = 10.0
"""Chosen [s]: so long ago it may be the cause of what is seen now."""
_HERE = 1.0


class Patience:
    """How interruptions of one run are borne.

    Parameters
    ----------
    seconds : longest silence that is waited out; 0 for none.
    say : where it is told. ask : whether it may be armed again.
    """

    def __init__(
        self, craft: MavlinkCraft, seconds: float, say: Callable[[str], None], ask: Callable[[str], bool]
    ) -> None:
        self._craft = craft
        self._seconds = seconds
        self._say, self._ask = say, ask
        self._found_armed = craft.armed
        self._borne = 0

    def bear(self, error: AutotuneError) -> bool:
        """Return whether *error* was a silence that is over, and the craft is neutral and as it was before.

        Raises
        ------
        OperatorStopped
            Ctrl-C while waiting.
        """
        if self._seconds <= 0.0 or self._borne >= MOST or not self._is_interruption(error):
            return False
        self._borne += 1
        if not self._is_back() or self._craft.telemetry.watchdog.fault is not None:
            return False
        try:
            return self._make_ready()
        except LinkLost:
            return False

    def _is_interruption(self, error: AutotuneError) -> bool:
        if isinstance(error, LinkLost):
            return True
        if not isinstance(error, GuardTripped):
            return False
        was_silent = self._craft.session.liveness.longest(_LATELY) > _TELLING
        return error.guard == "pause" or (error.guard in ("mode", "armed") and was_silent)

    def _is_back(self) -> bool:
        """Wait for the vehicle, as long as was stated."""
        session = self._craft.session
        if session.liveness.unheard <= _HERE:
            return session.liveness.longest(_LATELY) <= self._seconds
        left = self._seconds - session.liveness.unheard
        if left <= 0.0:
            return False
        self._say(
            f"silent for {session.liveness.unheard:.0f} s: waiting {left:.0f} s more (--patience) to go on; "
            "Ctrl-C ends it"
        )
        with suppress(LinkLost):
            return session.await_return(left)
        return False

    def _make_ready(self) -> bool:
        craft = self._craft
        craft.await_heartbeat()
        if not craft.armed:
            if self._found_armed:
                return False
            if not self._ask(
                "It was disarmed during the silence, by a failsafe or by somebody. Arm it again and go on?"
            ):
                return False
            self._say("arming it again, as announced")
            craft.arm()
        craft.neutral()
        return True
