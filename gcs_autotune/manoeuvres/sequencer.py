"""Fly manoeuvres and always clean up after them. No other module flies manoeuvres on a craft.

Clean-up is here and not in the manoeuvres, so that it happens on every ending: success, stop, abort, a bug, Ctrl-C, a
lost link. First the actuators are set to neutral, which is verified by the measured outputs. At the end of the run the
original mode and armed state are restored.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace

from gcs_autotune.craft import Craft, Intervention, Observation
from gcs_autotune.errors import AutotuneError, GuardTripped, LinkError, LinkLost, NotAsFound, PreconditionFailed
from gcs_autotune.frames import to_body
from gcs_autotune.manoeuvres.envelope import RATES, Envelope, Watch
from gcs_autotune.manoeuvres.manoeuvre import Manoeuvre, Outcome
from gcs_autotune.observer import LeftAs, Observer, Progress
from gcs_autotune.trial import Trial

__all__ = ["DISARMED_ITSELF", "Sequencer", "restore_on_exit"]


def _placed(progress: Progress, now: Observation) -> Progress:
    rate = now.value(RATES[progress.signal]) if progress.signal in RATES else math.nan
    return replace(progress, rate=rate, x=now.x, y=now.y, psi=now.psi)


class Sequencer:
    """Flies manoeuvres on a craft, inside an envelope.

    ``keep`` is called with the trial after every ending, before any error is raised, so that the record is always on
    disk.
    """

    def __init__(self, craft: Craft, envelope: Envelope, observer: Observer, keep: Callable[[Trial], None]) -> None:
        self._craft = craft
        self._envelope = envelope
        self._observer = observer
        self._keep = keep
        self._broken = ""
        self._home: Observation | None = None

    def fly(self, manoeuvre: Manoeuvre, stage: str = "", envelope: Envelope | None = None) -> Trial:
        """Fly *manoeuvre* to its end and return its record, which states how it ended.

        Raises
        ------
        PreconditionFailed
            An earlier manoeuvre of this sequencer was aborted.
        GuardTripped, LinkLost, TelemetryFault, OperatorStopped, ...
            The cause of an early end. By then the actuators are neutral and the record is kept.
        """
        if self._broken:
            raise PreconditionFailed(f"no further manoeuvre is flown after an abort ({self._broken}). Start a new run")
        outcome = Outcome("aborted", "a program error")
        self._craft.start_recording(manoeuvre.name)
        try:
            outcome = self._run(manoeuvre, stage, envelope or self._envelope)
        except BaseException as error:
            happened = error.happened if isinstance(error, GuardTripped) else str(error)
            outcome = Outcome("aborted", happened or type(error).__name__)
            self._broken = outcome.reason
            self._end(manoeuvre, outcome, error)
            if isinstance(error, GuardTripped):
                raise error.during(manoeuvre.name) from error
            raise
        return self._end(manoeuvre, outcome, None).proper

    def away(self, now: Observation) -> float:
        """Return the distance [m] from the start of the first manoeuvre; NaN if unknown."""
        return math.nan if self._home is None else math.hypot(now.x - self._home.x, now.y - self._home.y)

    def home_side(self, now: Observation) -> float:
        """Return the side of the start: 1 if the start of the first manoeuvre is to starboard of the bow, -1 if to
        port; 1 if unknown.
        """
        if self._home is None:
            return 1.0
        north, east = self._home.x - now.x, self._home.y - now.y
        return -1.0 if to_body(north, east, now.psi)[1] < 0.0 else 1.0

    def go_on(self) -> None:
        """Permit further manoeuvres, because the cause of the last abort has ended and the craft is neutral."""
        self._broken = ""

    def _run(self, manoeuvre: Manoeuvre, stage: str, envelope: Envelope) -> Outcome:
        craft, firmware = self._craft, self._craft.firmware
        craft.set_mode(manoeuvre.mode_of(firmware))
        observation = craft.observe()
        if self._home is None and math.isfinite(observation.x):
            self._home = observation
        if firmware.floats:
            envelope = replace(envelope, depth_excursion=math.inf)
        watch = Watch(envelope, observation, self._home)
        self._observer.note(watch.room)
        commands = manoeuvre.commands(observation)
        nearest, share = watch.check(observation)
        command = next(commands)
        while True:
            craft.send(command)
            for mark in manoeuvre.take_marks():
                craft.mark(mark)
            progress = manoeuvre.progress(observation)
            progress = replace(progress, stage=stage, guard=nearest, guard_share=share)
            self._observer.update(_placed(progress, observation))
            observation = craft.observe()
            if manoeuvre.outcome is not None:
                return manoeuvre.outcome
            nearest, share = watch.check(observation)
            where = watch.room_ends(observation)
            ended = manoeuvre.where_room_ends(where) if where else None
            if ended is None and manoeuvre.drifts:
                where, side = watch.drift_ends(manoeuvre.drifts, observation, craft.lateness)
                ended = manoeuvre.where_drift_ends(where, side) if where else None
            if ended is not None:
                return ended
            command = commands.send(observation)

    def _end(self, manoeuvre: Manoeuvre, outcome: Outcome, error: BaseException | None) -> Trial:
        failure: AutotuneError | None = None
        with self._craft.shielded():
            if isinstance(error, LinkLost):
                self._observer.say("Lost contact. Waiting up to 30 s for the vehicle to restore its state.")
            try:
                self._craft.neutral()
            except AutotuneError as trouble:
                failure = trouble
            recorded = self._craft.stop_recording(outcome.ending)
            trial = replace(recorded, reason=outcome.reason, meta={**recorded.meta, **manoeuvre.settings})
            self._keep(trial)
        if failure is not None:
            self._report_not_neutral(failure, is_known=isinstance(error, LinkLost) and isinstance(failure, LinkLost))
            if error is None:
                raise failure
        return trial

    def _report_not_neutral(self, failure: AutotuneError, *, is_known: bool) -> None:
        why = "" if is_known else f" ({failure})"
        self._observer.say(
            f"Neutral outputs could not be confirmed{why}. The vehicle's override time-out sets them to neutral."
        )


ROUNDS = 3
"""Number of attempts to restore a craft whose state changes again. Project choice."""

DISARMED_ITSELF = (
    "the vehicle was armed before the run, but a restart, a failsafe or another station disarmed it. This tool does "
    "not arm it again"
)
"""Note to the operator for a craft that was armed before the run: this program does not disarm it, and only the
operator arms it again.
"""


@contextmanager
def restore_on_exit(
    craft: Craft, observer: Observer, settled: Callable[[], None] = lambda: None
) -> Iterator[Observation]:
    """Restore actuators, armed state and mode on every exit, except for changes by another operator.

    Yield the first observation. *settled* is called only once everything is restored.

    Raises
    ------
    NotAsFound
        Something could not be restored; an earlier error is chained as its cause.
    """
    craft.take_over()
    found = craft.observe()
    observer.say(f"State before the run: mode {found.mode}, {_armed(found.armed)}")
    trouble: BaseException | None = None
    try:
        yield found
    except BaseException as error:
        trouble = error
        raise
    finally:
        with craft.shielded():
            differences, change = _put_back(craft, found)
            craft.give_back()
        observer.note(LeftAs(craft.mode, craft.armed, differences))
        order = change if change is not None and change.stands else None
        if change is not None and order is None and trouble is not None and change.what not in str(trouble):
            observer.say(change.what)
        if order is not None:
            why = "" if trouble is not None and order.what in str(trouble) else f": {order.what}"
            observer.say(f"left in mode {craft.mode} and {_armed(craft.armed)}{why}. {_left_by(order)}")
        if differences:
            raise _not_as_found(differences, trouble) from trouble
        settled()
        if order is None and found.armed and not craft.armed:
            observer.say(f"left in mode {found.mode} and disarmed: {DISARMED_ITSELF}")
        elif order is None:
            observer.say(f"mode and armed state restored: {found.mode}, {_armed(found.armed)}")


def _left_by(change: Intervention) -> str:
    """Return who made a *change* that stays, if it was a failsafe, and that it stays."""
    stays = "This tool does not change mode or armed state again"
    if not change.failsafe:
        return stays
    by = f"the autopilot's {change.failsafe}"
    who = by[:1].upper() + by[1:] if change.has_reported else f"Another station or {by}"
    return f"{who} made this change. {stays}"


def _armed(armed: bool) -> str:
    return "armed" if armed else "disarmed"


def _not_as_found(differences: dict[str, str], trouble: BaseException | None) -> NotAsFound:
    what = "; ".join(f"{name}: {why}" for name, why in differences.items())
    first = f"{trouble}. Afterwards the vehicle" if trouble is not None else "the vehicle"
    return NotAsFound(
        f"{first} could not be restored: {what}. The vehicle's override time-out sets the actuators to neutral. "
        "Check the vehicle by eye, and run `gcs-autotune restore` once it answers again",
        differences=differences,
    )


def _put_back(craft: Craft, found: Observation) -> tuple[dict[str, str], Intervention | None]:
    """Restore the craft and check again, since a restart may undo it. Return the differences and the first
    intervention.

    A command of another station is not undone. If it may have been a late copy of ours, it counts as a difference.
    """
    change: Intervention | None = None
    for _ in range(ROUNDS):
        differences, change = _put_back_once(craft, found, change)
        if differences:
            return differences, change
        try:
            craft.await_heartbeat()
        except LinkError as error:
            return {"mode": str(error)}, change
        change = _look(craft) or change
        if change is not None and change.stands:
            return {} if change.is_certain else _left_in_doubt(craft, found, change), change
        if craft.mode == found.mode and (found.armed or not craft.armed):
            return {}, change
    return {"mode": f"still {craft.mode} and {_armed(craft.armed)} after several attempts"}, change


def _left_in_doubt(craft: Craft, found: Observation, change: Intervention) -> dict[str, str]:
    """Return the differences from *found* due to a *change* that may have been another operator's command."""
    left = {} if craft.mode == found.mode else {"mode": f"is {craft.mode}: {change.what}"}
    if craft.armed and not found.armed:
        left["armed state"] = f"is armed: {change.what}"
    return left


def _look(craft: Craft) -> Intervention | None:
    """Return an intervention since the last check. A temporary change is accepted, and the next steps undo it."""
    change = craft.intervention()
    if change is not None and not change.stands:
        craft.accept_intervention()
    return change


def _put_back_once(
    craft: Craft, found: Observation, change: Intervention | None
) -> tuple[dict[str, str], Intervention | None]:
    differences: dict[str, str] = {}
    steps: list[tuple[str, Callable[[], None]]] = [("actuators", craft.neutral)]
    if not found.armed:
        steps.append(("armed state", craft.disarm))
    steps.append(("mode", lambda: craft.set_mode(found.mode)))
    steps.append(("overrides", craft.release))
    for what, act in steps:
        try:
            if what != "actuators":  # neutral waits for nothing, and looks by itself
                change = _look(craft) or change
            if change is None or not _forbids(change, what, craft):
                act()
        except LinkError as error:
            differences[what] = str(error)
            break
        except AutotuneError as error:
            change = _look(craft) or change
            if change is None or not _forbids(change, what, craft):
                differences[what] = str(error)
    return differences, change


def _forbids(order: Intervention, what: str, craft: Craft) -> bool:
    """Return whether *order*, a command of another operator, forbids the restore step *what*.

    A craft that another station has put, or may have put, into a driving mode stays armed, because that station needs
    it armed.
    """
    if what == "mode":
        return order.mode_stands
    if what == "armed state":
        drives = order.mode_stands and craft.mode not in craft.firmware.stops_in
        return order.armed_stands or drives
    return False
