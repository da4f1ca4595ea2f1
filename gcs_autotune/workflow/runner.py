"""Fly the manoeuvres of a job: retry after a silence, turn around between stages, and check success.

During a silence a failsafe or another station may have disarmed the vehicle or changed its mode. If a failsafe explains
the change, the operator is asked whether to continue. ``--yes`` does not answer this question. A vehicle that was armed
at the start is not armed again. A vehicle that has restarted ends the run: its estimator and message rates are lost.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import suppress
from copy import deepcopy
from dataclasses import replace
from functools import partial
from statistics import median

from gcs_autotune.axes import AxisKind
from gcs_autotune.craft import Intervention
from gcs_autotune.errors import (
    AutotuneError,
    GuardTripped,
    LinkLost,
    NotAchieved,
    PreconditionFailed,
    TelemetryFault,
)
from gcs_autotune.link import MavlinkCraft
from gcs_autotune.manoeuvres import (
    ComeToRest,
    Dive,
    Envelope,
    Manoeuvre,
    Sequencer,
    SignCheck,
    ThrustCheck,
    TurnAround,
    TurnAroundSettings,
    far_out,
)
from gcs_autotune.observer import Observer
from gcs_autotune.trial import Trial
from gcs_autotune.workflow.experiments import SHALLOW
from gcs_autotune.workflow.preflight import check_signs
from gcs_autotune.workflow.wrong_way import contradiction_in, straight_throttle, tripped, turning_time, why_tripped

__all__ = ["MOST", "ManoeuvreRunner", "Patience"]


class ManoeuvreRunner:
    """Flies manoeuvres on *craft* inside *envelope*; ``keep`` receives every record, as for the sequencer.

    A manoeuvre interrupted by a silence of up to *patience* [s] is flown again from its beginning. The craft dives
    again first if it has risen. *ask* is called to confirm if mode or armed state changed during the silence; by
    default it returns no. *gains*: gains depend on the records, so the run stops if two sensors contradict each other.
    """

    def __init__(
        self,
        craft: MavlinkCraft,
        envelope: Envelope,
        observer: Observer,
        keep: Callable[[Trial], None],
        patience: float = 0.0,
        ask: Callable[[str], bool] = lambda question: False,
        *,
        gains: bool = False,
    ) -> None:
        self._gains = gains
        self._craft = craft
        self._observer = observer
        self._patience = Patience(craft, patience, observer.say, ask)
        self._dive: Dive | None = None
        self._envelope = envelope
        self._last: Trial | None = None
        self._straight = 0.0
        self._turnings: list[float] = []
        self._spoilt = 0
        self.contradicted = False
        """Whether sensors contradicted each other in a manoeuvre that later stages depend on."""
        self.too_fast = ""
        """Sentence that states why the autopilot may drive the boat too fast; empty if unknown."""
        self._sequencer = Sequencer(craft, envelope, observer, self._keeping(keep))

    def _keeping(self, keep: Callable[[Trial], None]) -> Callable[[Trial], None]:
        def keep_and_remember(trial: Trial) -> None:
            if self._last is not None:
                self._straight = max(self._straight, straight_throttle(self._last))
            self._last = trial
            needed = turning_time(trial, TurnAroundSettings(0.0).output)
            self._turnings += [needed] * math.isfinite(needed)
            keep(trial)

        return keep_and_remember

    def _with_turning(self, envelope: Envelope) -> Envelope:
        """Return *envelope* with the distance to turn around that the records so far show; the median of several."""
        needed = median(self._turnings) if self._turnings else 0.0
        return replace(envelope, turning=min(max(envelope.turning, needed), MOST_TURNING * envelope.turning))

    @property
    def speed_limit(self) -> float:
        """Safety limit of the speed over ground [m/s]."""
        return self._envelope.speed_limit

    def fly(self, manoeuvre: Manoeuvre, stage: str, envelope: Envelope | None = None) -> Trial:
        """Fly *manoeuvre*, which must succeed; other errors as for the sequencer.

        Raises
        ------
        NotAchieved
            The manoeuvre did not succeed.
        """
        if isinstance(manoeuvre, Dive):
            self._dive = deepcopy(manoeuvre)
        flown = self.attempt(manoeuvre, stage, envelope)
        if flown.ending == "aborted":
            raise NotAchieved(f"{stage}: {flown.reason}")
        return flown

    def attempt(self, manoeuvre: Manoeuvre, stage: str, envelope: Envelope | None = None) -> Trial:
        """Fly *manoeuvre* and return it, however it ended.

        It is flown again if a silence interrupts it, or if it fails while this computer paused.
        """
        again = deepcopy(manoeuvre)
        while True:
            begun = self._craft.clock.now()
            try:
                flown = self._sequencer.fly(manoeuvre, stage, self._with_turning(envelope or self._envelope))
                if flown.ending != "aborted" or not self._is_spoilt_by_us(begun, flown.reason):
                    self._check_sensors_agree(manoeuvre)
                    return flown
            except AutotuneError as error:
                if not self.bear(error):
                    self._explain(error)
                    raise
                self._observer.say(str(error))
            self._observer.say(f"continuing: {stage or again.name} is flown again from its start")
            self._come_down(again)
            manoeuvre = deepcopy(again)

    def check_steering(self, check: SignCheck | ThrustCheck, envelope: Envelope) -> None:
        """Check the steering of the craft while another degree of freedom is tested.

        A craft that turns by itself or hardly responds is only reported here. A tune of the steering axis rejects it.

        Raises
        ------
        PreconditionFailed
            It turns the wrong way, or its sensors contradict each other.
        """
        try:
            check_signs(check, partial(self.attempt, envelope=replace(envelope, heading_excursion=math.inf)))
        except PreconditionFailed as error:
            seen = check.answer if isinstance(check, SignCheck) else None
            wrong = seen is not None and (seen.is_reversed or seen.unheeded is not None)
            if wrong or self.contradicted:
                raise
            self._observer.say(f"steering check: {error}")

    def _is_spoilt_by_us(self, begun: float, reason: str) -> bool:
        """Return whether this computer paused and left the vehicle without commands since link time *begun* [s].

        In that case the craft did not follow our commands, and the *reason* for its ending is not its own.

        Raises
        ------
        PreconditionFailed
            This happened too many times in one run.
        """
        pause = self._craft.longest_pause(begun)
        if pause < LEFT_ALONE:
            return False
        self._spoilt += 1
        probable = (
            f"this computer paused for {pause:.1f} s without sending commands, so the vehicle may have released the "
            "overrides"
        )
        if self._spoilt > MOST_SPOILT:
            raise PreconditionFailed(
                f"{reason}. Probable cause: {probable}. Close other programs or use a faster computer"
            )
        self._observer.say(f"{reason}. Probable cause: {probable}")
        return True

    def _explain(self, error: AutotuneError) -> None:
        """Raise an error that explains why a limit tripped, if the record shows a reversed output or contradicting
        sensors."""
        if not isinstance(error, GuardTripped) or self._last is None:
            return
        if error.guard == "speed" and self.too_fast:
            raise PreconditionFailed(f"{self._last.name}: {self.too_fast}. {tripped(error)}") from error
        why = why_tripped(self._last, error, self._craft.firmware, self._craft.servos, self._straight)
        if why is not None:
            raise why from error
        found = contradiction_in(self._last)
        if found:
            raise PreconditionFailed(f"{self._last.name}: {found}. {tripped(error)}") from error

    def _check_sensors_agree(self, manoeuvre: Manoeuvre) -> None:
        """Check that the sensors agree in the record just flown. If only a record is needed, only report a
        disagreement.

        Raises
        ------
        PreconditionFailed
            They contradict each other, and gains or a loop of the autopilot depend on them.
        """
        found = "" if self._last is None else contradiction_in(self._last)
        if not found:
            return
        if self._gains or manoeuvre.purpose == "check" or not manoeuvre.in_manual:
            self.contradicted = True
            raise PreconditionFailed(f"{manoeuvre.name}: {found}. The run was ended")
        self._observer.say(f"{manoeuvre.name}: {found}")

    def bear(self, error: AutotuneError) -> bool:
        """Return whether *error* was a silence of the link that has ended, with the craft neutral and ready to
        continue.
        """
        if not self._patience.bear(error):
            return False
        self._sequencer.go_on()
        return True

    def _come_down(self, before: Manoeuvre) -> None:
        """Dive again *before* a manoeuvre at depth if the craft has risen."""
        if self._dive is not None and not isinstance(before, Dive) and self._craft.observe().z < SHALLOW:
            self._sequencer.fly(deepcopy(self._dive), "diving")

    def turn_around(self, throttle: float, ahead: float = math.inf, *, last: bool = False) -> bool:
        """Turn a boat around if the space requires it, and return whether it did. Other craft stay where they are.

        It turns towards the start, because a turn to the other side takes more space.

        ahead : duration [s] of the next stage; infinite: turn in any case. last : whether the next stage is the last
            one.
        """
        if not self._craft.firmware.needs_way:
            return False
        now = self._craft.observe()
        if not far_out(self._envelope, self._sequencer.away(now), ahead, last=last):
            return False
        turn = TurnAroundSettings(throttle)
        turn = replace(turn, output=self._sequencer.home_side(now) * turn.output)
        self._try(TurnAround(turn), "turning around", replace(self._envelope, heading_excursion=math.inf))
        return True

    def come_to_rest(self, stage: str, axis: AxisKind) -> None:
        """Bring a craft that can stay where it is to rest, as the beginning of *stage*, a step of *axis*.

        A boat drifts with neutral outputs.
        """
        if not self._craft.firmware.floats:
            self._try(ComeToRest(axis.stepped, axis.excitation.names.force), stage)

    def _try(self, manoeuvre: Manoeuvre, stage: str, *envelope: Envelope) -> None:
        """Fly *manoeuvre*, and only report that it did not succeed."""
        flown = self.attempt(manoeuvre, stage, *envelope)
        if flown.ending == "aborted":
            self._observer.say(f"{stage}: {flown.reason}")


MOST_TURNING = 3.0
"""Largest factor on the assumed distance to turn around. A record that shows more is not believed. Project choice."""
LEFT_ALONE = 0.5
"""Time [s] without commands after which ArduRover without a receiver assumes that its pilot is lost (mid-2025 builds).
It is vehicle time."""
MOST_SPOILT = 2
"""Largest number of manoeuvres of one run that are repeated because this computer paused. Project choice."""
MOST = 5
"""Largest number of interruptions in one run. A link that fails more often is not usable for a tune. Project choice."""
_PROMPT = 0.8
"""Response time [s] of a link up to which its commands count as timely. Project choice."""
_INTERRUPTIONS = ("pause", "failsafe", "mode", "armed", "late")
"""Guards after which a run may continue if :class:`Patience` permits it."""
_LATELY = 10.0
"""Age [s] above which a past silence is not considered the cause of a present event. Project choice."""
_HERE = 1.0


class Patience:
    """Decides after which interruptions a run continues.

    Parameters
    ----------
    seconds : longest silence to wait for; 0 for none.
    say : receives the reports. ask : asks whether the vehicle may be armed again.
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
        """Return whether *error* was a silence of the link that has ended, with the craft neutral and in its previous
        state.

        Raises
        ------
        OperatorStopped
            Ctrl-C while waiting.
        TelemetryFault
            The autopilot restarted during the silence.
        """
        if self._seconds <= 0.0 or self._borne >= MOST or not self._is_interruption(error):
            return False
        self._borne += 1
        if not self._is_back():
            return False
        try:
            return self._make_ready()
        except LinkLost:
            return False
        except GuardTripped as order:
            self._say(str(order))
            return False
        finally:
            watchdog = self._craft.telemetry.watchdog
            if watchdog.has_restarted and not isinstance(error, TelemetryFault):
                watchdog.check()

    def _is_interruption(self, error: AutotuneError) -> bool:
        return isinstance(error, LinkLost) or (isinstance(error, GuardTripped) and error.guard in _INTERRUPTIONS)

    def _is_back(self) -> bool:
        """Wait for the vehicle, for the time announced."""
        session = self._craft.session
        if session.liveness.actual_silence <= _HERE:
            return session.liveness.longest(_LATELY) <= self._seconds
        left = self._seconds - session.liveness.actual_silence
        if left <= 0.0:
            return False
        self._say(
            f"no messages for {session.liveness.actual_silence:.0f} s: waiting {left:.0f} s more (--patience); "
            "Ctrl-C ends the run"
        )
        with suppress(LinkLost):
            return session.await_return(left)
        return False

    def _make_ready(self) -> bool:
        craft = self._craft
        craft.await_heartbeat()
        craft.check_restart()
        change = craft.intervention()
        if change is not None and not self._may_undo(change):
            return False
        if not craft.armed:
            self._say("arming the vehicle again, as announced")
            craft.arm()
        craft.neutral()
        session = craft.session  # where our commands came late: until they do not
        session.wait_for(lambda: True if craft.latency.lateness < _PROMPT else None, self._seconds)
        return craft.telemetry.watchdog.fault is None

    def _may_undo(self, change: Intervention) -> bool:
        """Return whether the operator agrees to undo this change, and nothing more has happened until then."""
        craft = self._craft
        seen = craft.mode, craft.armed
        if not change.may_go_on or (self._found_armed and not craft.armed):
            return False
        how = "Arm the vehicle again and continue" if not craft.armed else f"Leave {craft.mode} again and continue"
        if not self._ask(f"{change.what[:1].upper()}{change.what[1:]}. {how}?"):
            return False
        craft.await_heartbeat()
        if (craft.mode, craft.armed) != seen:
            return False
        craft.accept_intervention()
        return True
