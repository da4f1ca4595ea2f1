"""One job on one vehicle: connect, declare, announce, ask, arm, fly, restore.

``tune``, ``experiment`` and ``fly`` each declare a :class:`Mission`. :func:`run_mission` carries out any of them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from typing import Any, Generic, TypeVar

from gcs_autotune.craft import Observation
from gcs_autotune.errors import OperatorStopped, PreconditionFailed
from gcs_autotune.link import Journal, MavlinkCraft, fingerprint_of
from gcs_autotune.manoeuvres import Envelope, restore_on_exit
from gcs_autotune.observer import Intention, Intentions
from gcs_autotune.trial import Trial
from gcs_autotune.workflow.announcement import after_a_silence, in_modes
from gcs_autotune.workflow.background import agreed, ask_now, beside
from gcs_autotune.workflow.connection import arming, connect_craft, say_link_times
from gcs_autotune.workflow.itinerary import Itinerary, MissionLog
from gcs_autotune.workflow.jit_warmup import await_warmup, jit_warmup
from gcs_autotune.workflow.onboard_log import RunLog, log_of_run
from gcs_autotune.workflow.open_runs import forget_run, note_run, refuse_open_runs
from gcs_autotune.workflow.operator import Operator
from gcs_autotune.workflow.preflight import make_ready
from gcs_autotune.workflow.record import RunDirectory
from gcs_autotune.workflow.resuming import note_setting_out
from gcs_autotune.workflow.runner import ManoeuvreRunner
from gcs_autotune.workflow.settings import CommonSettings
from gcs_autotune.workflow.worker import Worker

__all__ = ["Mission", "Visit", "run_mission", "visiting", "watching"]

Log = TypeVar("Log", bound=MissionLog)


@dataclass(frozen=True, slots=True, eq=False)
class Visit(Generic[Log]):
    """What a job has once it is connected: the craft, settings, record and worker. ``worker`` computes while the link
    is served.
    """

    common: CommonSettings
    operator: Operator
    log: Log
    record: RunDirectory
    craft: MavlinkCraft
    worker: Worker

    def keep(self, trial: Trial) -> None:
        """Write *trial* to disk while the link is served."""
        beside(self.craft, partial(self.record.keep, trial))

    def runner(self, envelope: Envelope, keep: Callable[[Trial], None], *, gains: bool = False) -> ManoeuvreRunner:
        """Return the runner that flies manoeuvres on this vehicle; arguments as for :class:`.ManoeuvreRunner`."""
        ask = partial(ask_now, self.craft, self.operator, self.log)
        return ManoeuvreRunner(self.craft, envelope, self.log, keep, self.common.patience, ask, gains=gains)

    def agrees(self, question: str) -> bool:
        """Return whether the operator agrees. A simulated vehicle needs no confirmation, nor a run of an agreed job.

        Raises
        ------
        OperatorStopped
            A stop was requested before the question, for example while a design was computed.
        """
        self.craft.session.operator.check()
        if self.common.agreed:
            self.log.say(f"{question} yes (agreed for the whole job)")
            return True
        return agreed(self.craft, self.operator, self.log, question)


@contextmanager
def visiting(
    common: CommonSettings,
    operator: Operator,
    log: Log,
    record: RunDirectory,
    axis: str,
    *,
    dofs: tuple[str, ...] = (),
    laws: tuple[str, ...] = (),
) -> Iterator[Visit[Log]]:
    """Connect to the vehicle and compile for *dofs* and *laws* in the background.

    On a slow link *axis* has priority.
    """
    with (
        jit_warmup(common.connection.uri, dofs, laws) as worker,
        connect_craft(common, operator, log, record, axis) as craft,
    ):
        yield Visit(common, operator, log, record, craft, worker)


@contextmanager
def watching(
    common: CommonSettings, operator: Operator, log: Log, record: RunDirectory, axis: str, dofs: tuple[str, ...]
) -> Iterator[Visit[Log]]:
    """Connect to the vehicle as :func:`visiting`, over a link that need not carry what a control loop needs."""
    with (
        jit_warmup(common.connection.uri, dofs, ()) as worker,
        connect_craft(common, operator, log, record, axis, only_watches=True) as craft,
    ):
        yield Visit(common, operator, log, record, craft, worker)


def _nothing(*_: object) -> None:
    """Do nothing: the default for the optional steps of a mission."""


@dataclass(frozen=True, slots=True, eq=False)
class Mission:
    """What a job does on its vehicle, declared before anything is armed, moved or written.

    Attributes
    ----------
    itinerary : the stages with their times.
    modes : flight modes used; if empty, nothing is flown, for the reason in ``movements``.
    movements, needs : sentences on what moves, and on the space, time and battery needed.
    fly : flies the mission; called when armed, with the open journal.
    writes : sentence on what may be written.
    moves_briefly, writes_briefly : what moves and what may be written in one line of a terminal; empty: the sentences.
    held : parameters (name -> value) that a run which resumes this one must find; None: it cannot be resumed.
    prepare : called once the operator has agreed, before anything is armed.
    load : called with the open journal before arming. unload : undoes it, once mode and armed state are restored.
    finish : called on every ending once the vehicle is restored.
    way_on : sentence on how to continue after an error; empty if no trial can be reused.
    """

    itinerary: Itinerary
    modes: tuple[str, ...]
    movements: str
    needs: tuple[Intention, ...]
    fly: Callable[[Journal], None]
    writes: str = "write no parameter"
    moves_briefly: str = ""
    writes_briefly: str = ""
    held: Mapping[str, float] | None = None
    prepare: Callable[[], None] = _nothing
    load: Callable[[Journal], None] = _nothing
    unload: Callable[[], None] = _nothing
    finish: Callable[[], None] = _nothing
    way_on: Callable[[BaseException], str] = lambda error: ""


def run_mission(
    visit: AbstractContextManager[Visit[Log]], declare: Callable[[Visit[Log]], Mission], log: MissionLog
) -> RunLog:
    """Carry out the mission that *declare* returns for the vehicle of *visit*. Return the vehicle's onboard log of the
    mission.

    Raises
    ------
    AutotuneError
        The cause of an early end. By then the vehicle is restored, or ``NotAsFound`` lists what could not be restored.
    """
    mission: Mission | None = None
    try:
        with visit as at:
            mission = declare(at)
            if mission.held is not None:
                note_setting_out(at.record, at.common, at.craft, mission.held)
            await_warmup(at.craft, at.worker, log)
            with log_of_run(at.common.fetch_log, at.craft, at.record, at.operator, log) as onboard:
                _carry_out(mission, at)
    except BaseException as error:
        log.abort(error)
        way_on = "" if mission is None else mission.way_on(error)
        if way_on:
            log.offer_way_on(way_on)
        raise
    return onboard


def _carry_out(mission: Mission, visit: Visit[Log]) -> None:
    if not mission.modes:
        visit.log.say(mission.movements)
        mission.prepare()
        return
    _announce(mission, visit)
    mission.prepare()
    try:
        with _armed(mission, visit) as journal:
            mission.fly(journal)
    finally:
        mission.finish()


def _announce(mission: Mission, visit: Visit[Log]) -> None:
    """Announce what will be done and ask for confirmation.

    Raises
    ------
    OperatorStopped
        The answer was no.
    """
    craft = visit.craft
    visit.log.itinerary = mission.itinerary
    modes = in_modes(mission.modes, craft.mode, "at the end")
    visit.log.announce(
        Intentions(
            (
                arming(craft, modes.brief),
                modes,
                Intention(f"move: {mission.movements}", "Moves", mission.moves_briefly or mission.movements),
                *mission.needs,
                *after_a_silence(visit.common, armed=craft.armed),
                Intention(
                    mission.writes,
                    "Writes",
                    mission.writes_briefly
                    or mission.writes.removeprefix("write ").replace("and restore ", "and restores "),
                ),
            )
        )
    )
    if not visit.agrees("Go ahead?"):
        raise OperatorStopped("not started: the answer was no. Nothing was armed, moved or written")


@contextmanager
def _armed(mission: Mission, visit: Visit[Log]) -> Iterator[Journal]:
    """Arm, and restore everything on exit. The journal is on disk before anything is armed, moved or written.

    It is closed only when the vehicle was restored. Otherwise ``gcs-autotune restore`` has to be run.

    Raises
    ------
    PreconditionFailed
        The journal cannot be written; then nothing is done.
    NotAsFound
        Something could not be restored.
    """
    craft, log, record = visit.craft, visit.log, visit.record
    journal: Journal | None = None

    def settle() -> None:
        if journal is not None:
            with craft.shielded():
                mission.unload()
        try:
            if journal is not None:
                journal.close()
                forget_run(record.journal)
        except PreconditionFailed as error:  # a disk that is full by now does no harm
            log.say(
                f"everything is restored, but this could not be written to the journal ({error}). Run `gcs-autotune "
                "restore` to check"
            )

    def open_journal(found: Observation) -> Journal:
        refuse_open_runs(craft)
        if not craft.session.transport.is_simulated:  # no other run uses a vehicle in this process
            note_run(record.journal)
        craft.session.at_work = True
        opened = Journal(
            record.journal,
            vehicle=craft.session.vehicle,
            link=visit.common.connection.uri,
            mode=found.mode,
            armed=found.armed,
            fingerprint=fingerprint_of(craft.parameters),
        )
        craft.on_order = lambda event, what: beside(craft, partial(note_order, opened, event, what))
        return opened

    def note_order(opened: Journal, event: str, what: Mapping[str, Any]) -> None:
        with suppress(PreconditionFailed):  # a full disk must not prevent neutral; restore then asks
            opened.record(event, **what)

    try:
        with restore_on_exit(craft, log, settle) as found:
            journal = open_journal(found)
            mission.load(journal)
            make_ready(craft, log)
            craft.arm()
            say_link_times(craft, log)
            yield journal
    finally:
        if journal is not None:
            craft.on_order = lambda event, what: None
            craft.session.at_work = False
            journal.leave()
