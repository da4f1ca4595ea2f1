"""Restore a vehicle to its state before an interrupted run, using the run's journal.

Some changes of mode, armed state or parameters are explained neither by the journal nor by a failsafe or restart. These
belong to another operator and stay unless the user decides otherwise.

The restore itself may be interrupted at any moment and repeated. Each step checks first and does only what is left to
do. The journal is closed last.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from datetime import UTC, datetime
from functools import partial
from pathlib import Path

from gcs_autotune.errors import AutotuneError, LinkLost, NotAsFound, OperatorStopped, UsageError, WrongVehicle
from gcs_autotune.firmware import SetFailsafe, firmware_for, read_servo_map
from gcs_autotune.link import (
    Commands,
    Journal,
    JournalState,
    MissionItem,
    Parameters,
    Session,
    StoredMission,
    difference,
    drop_script,
    is_ours,
    read_failsafes,
    read_mission,
    read_outputs,
    same_float32,
    same_mission,
    write_mission,
)
from gcs_autotune.manoeuvres import DISARMED_ITSELF
from gcs_autotune.mavlink import Message, load_params, message_number, save_params
from gcs_autotune.observer import Observer
from gcs_autotune.workflow.connection import connect
from gcs_autotune.workflow.open_runs import forget_run
from gcs_autotune.workflow.operator import Operator, answers_questions
from gcs_autotune.workflow.record import JOURNAL, SAVED
from gcs_autotune.workflow.settings import Connection

__all__ = ["is_settled", "link_of", "restore_parameters", "restore_run", "save_parameters", "settled_words"]


_PATIENCE = 30.0
"""Time [s] to wait for a silent vehicle. Project choice."""
_FRESH = 3.5
"""Age [s] up to which a state counts as current: three heartbeats. Project choice."""
_ANY_WAY = 2.0
"""Tolerated difference [s] between the delays of two time stamps. Project choice."""
_BOOT_SLACK = 30.0
"""Tolerated difference [s] between two clocks, including a slow disk.

No autopilot is power-cycled faster. Project choice.
"""
_ARMED, _MISSION = "armed state", "mission"
_NEUTRAL = 0.03
"""Fraction of full output that still counts as neutral. Project choice."""


def link_of(run: Path | None) -> str:
    """Return the connection string in the journal of *run* (a directory or a file in it; None: the newest run).

    Raises
    ------
    UsageError
        There is no journal to read it from.
    """
    folder = run if run is None or run.is_dir() or run.name == JOURNAL else run.parent
    known = folder is None or folder.name == JOURNAL or any(folder.glob(JOURNAL)) or any(folder.glob(f"*/{JOURNAL}"))
    path = _journal_of(folder, finished=folder is not None) if known else None
    link = Journal.read(path).link if path is not None else ""
    if not link:
        raise UsageError("no run records how the vehicle was connected. Use --connect URI")
    return link


def is_settled(run: Path | None) -> bool:
    """Return whether *run* (a directory or journal; None: the newest unfinished run) restored its vehicle.

    Raises
    ------
    UsageError
        *run* has no journal.
    """
    path = _journal_of(run)
    return path is None or _is_finished(path)


def settled_words(run: Path | None) -> str:
    """Return a sentence for the operator if :func:`is_settled` holds for *run*."""
    if run is None:
        return "Nothing to restore: the folder runs/ contains no unfinished run."
    return f"Nothing to restore: {run} has already restored everything."


def _is_finished(path: Path) -> bool:
    return Journal.read(path).is_settled


def restore_run(
    connection: Connection, run: Path | None, operator: Operator, observer: Observer
) -> Mapping[str, tuple[float, float]]:
    """Complete the clean-up of *run* (a directory or journal; None: the newest unfinished run).

    Disarms a vehicle that was disarmed before the run. Restores and verifies each changed parameter, restores the mode,
    checks that the outputs are neutral, and closes the journal. Returns name -> (present, old) of what was restored.
    The operator is asked about changes that another operator has made since; ``--yes`` does not answer that.

    Raises
    ------
    UsageError
        There is no journal.
    PreconditionFailed
        The run is still going on in another program, or the disk is full.
    WrongVehicle
        The vehicle on this link is not the one of the journal; nothing is written.
    OperatorStopped
        The answer was no, or Ctrl-C was pressed. The journal stays open for what is not done yet.
    NotAsFound
        Something could not be restored, or belongs to another operator and there was no operator to ask. The journal
            stays open for another try.
    """
    path = _journal_of(run)
    if path is None or _is_finished(path):
        return {}
    journal = Journal.resume(path)
    try:
        state = Journal.read(path)
        observer.say(f"journal {path}: {_owed(state)}")
        with connect(connection, operator, observer) as session:
            changes = _Restoring(session, state, operator, observer, journal).run()
        journal.close()
        forget_run(path)
    finally:
        journal.leave()
    return changes


def _owed(state: JournalState) -> str:
    """Return in words what is still to be restored."""
    firmware = state.vehicle.get("firmware", "?")
    owed = [*state.debts, *(["the mission"] if state.mission is not None else []), *state.scripts]
    if owed:
        return f"still to be restored on {firmware}: {', '.join(owed)}"
    return f"all parameters are restored on {firmware}. The mode or the armed state may still need restoring"


class _Restoring:
    """The steps of one restore, within one session."""

    def __init__(
        self, session: Session, state: JournalState, operator: Operator, observer: Observer, journal: Journal
    ) -> None:
        vehicle = session.vehicle
        assert vehicle is not None
        self._session, self._state, self._operator, self._observer = session, state, operator, observer
        self._journal = journal
        self._parameters = Parameters(session)
        _check_identity(session, state, self._parameters)
        self._firmware = firmware_for(vehicle.autopilot, vehicle.vehicle_type)
        self._commands = None if self._firmware is None else Commands(session, self._firmware)
        self._differences: dict[str, str] = {}
        self._boot = self._time_since_boot()
        self._failsafes = () if self._firmware is None else read_failsafes(self._parameters, self._firmware)
        self._left: dict[str, str] = {}
        self._owes_mission = False

    def run(self) -> dict[str, tuple[float, float]]:
        found = self._parameters.read_confirmed(self._state.debts)
        changes = {n: (found[n], v) for n, v in self._state.debts.items() if not same_float32(found[n], v)}
        foreign = {n: f"its value {now:g} was not written by the run" for n, (now, _) in changes.items()}
        self._left = {n: why for n, why in foreign.items() if not self._is_ours(n, changes[n][0])}
        self._left |= self._state_changed_by_others(self._state.left_in, armed_by_us=self._state.armed_by_us)
        self._see_mission()
        decided = self._decide(changes)
        changes = {n: change for n, change in changes.items() if n not in self._left}
        wanted = self._wanted(changes)
        if wanted and not self._operator.ask(f"Restore: {' and '.join(wanted)}?", self._session.pump):
            raise OperatorStopped(
                f"nothing was done: the answer to {' and '.join(wanted)} was no. The vehicle is unchanged"
            )
        if self._disarms:
            self._try("armed state", self._command().disarm)
        for name, (_, value) in changes.items():
            self._try(name, partial(self._parameters.write, name, value))
        self._put_back_state()
        self._put_back_mission()
        self._drop_scripts()
        if not self._differences:
            self._try("mode", self._session.await_heartbeat)  # a vehicle that restarts now is in its boot mode
        if not self._differences and (self._disarms or self._changes_mode):
            self._left |= self._state_changed_by_others((), armed_by_us=False)
        if not self._differences and (self._disarms or self._changes_mode):
            self._observer.say(
                f"the vehicle is in {self._command().mode} now, possibly after a restart: restoring it again"
            )
            self._put_back_state()
        for name, value in self._state.debts.items():
            if name in decided and name in self._left:
                self._journal.record("returned", name=name, value=found[name], by="another station")
            elif name not in self._differences and name not in self._left:
                self._journal.record("returned", name=name, value=value)
        if (
            self._state.mission is not None
            and _MISSION not in self._differences
            and (_MISSION not in self._left or _MISSION in decided)
        ):
            self._journal.record("mission_returned")
        undecided = {what: why for what, why in self._left.items() if what not in decided}
        if self._differences:
            shown = "; ".join(f"{what}: {why}" for what, why in self._differences.items())
            raise NotAsFound(
                f"could not be restored: {shown}. Fix this, then run `gcs-autotune restore` again",
                differences=self._differences,
            )
        if wanted:
            self._observer.say(f"done: {' and '.join(wanted)}; verified by reading back")
        if undecided:
            shown = "; ".join(f"{what}: {why}" for what, why in undecided.items())
            raise NotAsFound(
                f"left unchanged, since another operator may have set it: {shown}. Run `gcs-autotune restore` "
                "without --yes to decide each",
                differences=undecided,
            )
        if self._state.armed and not self._session.armed:
            self._observer.say(DISARMED_ITSELF)
        return changes

    def _see_mission(self) -> None:
        """Find whether the vehicle has our mission, its own one, or that of another station."""
        owed = self._state.mission
        if owed is None:
            return
        found = read_mission(self._session).items
        if same_mission(found, _items(owed["items"])):
            return
        self._owes_mission = True
        if not is_ours(found, _items(owed["items"]), _items(owed["ours"])):
            self._left[_MISSION] = "its mission is neither the run's nor the one before it"

    def _put_back_mission(self) -> None:
        """Restore the mission, in a mode that does not fly it."""
        owed = self._state.mission
        if owed is None or not self._owes_mission or _MISSION in self._left:
            return
        if self._firmware is not None and self._command().mode == self._firmware.mission_mode:
            self._differences[_MISSION] = f"the vehicle is in {self._firmware.mission_mode}. Change its mode first"
            return
        mission = StoredMission(_items(owed["items"]), int(owed["current"]))
        self._try(_MISSION, partial(write_mission, self._session, mission))

    def _drop_scripts(self) -> None:
        """Remove the scripts that the run left on the vehicle."""
        for path in self._state.scripts:
            self._try(path, partial(drop_script, self._session, self._command(), path))
            if path not in self._differences:
                self._journal.record("script_removed", path=path)

    def _put_back_state(self) -> None:
        """Disarm a vehicle that was disarmed before the run, restore the mode and check that the outputs are
        neutral."""
        if self._disarms:
            self._try("armed state", self._command().disarm)
        if self._changes_mode:
            self._try("mode", partial(self._command().set_mode, self._state.mode))
        if self._state.armed is False and _ARMED not in self._left:
            self._try("actuators", self._check_neutral)

    @property
    def _disarms(self) -> bool:
        return self._state.armed is False and self._session.armed and _ARMED not in self._left

    @property
    def _changes_mode(self) -> bool:
        return self._is_in_another_mode and "mode" not in self._left

    @property
    def _is_in_another_mode(self) -> bool:
        return bool(self._state.mode) and self._commands is not None and self._commands.mode != self._state.mode

    # --- whose it is --------------------------------------------------------------------------------------

    def _is_ours(self, name: str, held: float) -> bool:
        return any(same_float32(held, value) for value in self._state.written.get(name, ()))

    def _state_changed_by_others(self, left_in: Sequence[str], *, armed_by_us: bool) -> dict[str, str]:
        """Return which of mode and armed state were changed by another operator.

        The run itself *left_in* a mode. Changes by the vehicle itself do not count. A vehicle that another operator has
        put into a driving mode stays armed, because that operator needs it armed.
        """
        if self._commands is None or self._firmware is None:
            return {}
        with suppress(LinkLost):
            self._session.ask_state(_FRESH)
        left, mode, restarted = {}, self._commands.mode, self._has_restarted()
        outcomes: list[str] = []
        if self._state.left_in or restarted:  # else the run saw another operator order the mode
            outcomes += [outcome for failsafe in self._acting() for outcome in failsafe.outcomes]
        if restarted:
            outcomes.append(self._booted_mode())
        if self._is_in_another_mode and mode not in (*left_in, *outcomes):
            left["mode"] = f"its mode is {mode}, which neither the run nor a failsafe set"
        drives = "mode" in left and mode not in self._firmware.stops_in
        if self._state.armed is False and self._session.armed and (drives or restarted or not armed_by_us):
            left[_ARMED] = f"it is armed in {mode}" + ("" if drives else ", and not by the run")
        return left

    def _acting(self) -> list[SetFailsafe]:
        """Return the failsafes that act when this program sends nothing more."""
        heard = self._heard("RC_CHANNELS")
        has_receiver = heard is not None and heard.chancount > 0
        return [f for f in self._failsafes if not (f.by_overrides and has_receiver)]

    def _booted_mode(self) -> str:
        assert self._firmware is not None
        name, without = self._firmware.boots_in
        return self._firmware.mode_name(int(self._parameters.read_existing([name]).get(name, without)))

    def _has_restarted(self) -> bool:
        """Return whether the vehicle has restarted since the last command or the last check."""
        before, now = self._boot, self._time_since_boot()
        if now is None:
            return False
        self._boot = now
        if any(then is not None and now < then - _ANY_WAY for then in (before, self._state.boot)):
            return True
        if self._state.boot is None:
            return False
        ago = 0.0 if self._session.transport.is_simulated else _seconds_since(self._state.stamp)
        return now - self._state.boot < ago - _BOOT_SLACK

    def _time_since_boot(self) -> float | None:
        heard = self._heard("SYSTEM_TIME")
        return None if heard is None else heard.time_boot_ms * 1e-3

    def _heard(self, name: str) -> Message | None:
        """Return a message *name*, requested up to three times; None if it did not arrive."""
        heard: list[Message] = []
        stop = self._session.listen(name, heard.append)
        try:
            for _ in range(3):
                self._session.request_message(message_number(name))
                if self._session.wait_for(lambda: True if heard else None, 1.0):
                    break
        except LinkLost:
            return None  # the caller that needs the vehicle reports it
        finally:
            stop()
        return heard[-1] if heard else None

    def _decide(self, changes: Mapping[str, tuple[float, float]]) -> set[str]:
        """Ask about each change that another operator may want to keep; return the decisions."""
        if not answers_questions(self._operator):
            return set()
        asked = dict(self._left)
        for what, why in asked.items():
            known = {"mode": f"go to {self._state.mode}", _ARMED: "disarm", _MISSION: "upload the old mission"}
            undo = known.get(what) or f"write {changes[what][1]:g}"
            if self._operator.ask(
                f"{what}: {why}. Another operator may have set it. Change it anyway ({undo})?", self._serve
            ):
                del self._left[what]
        return set(asked)

    def _serve(self) -> None:
        self._session.pump()

    def _wanted(self, changes: Mapping[str, tuple[float, float]]) -> list[str]:
        """Return a sentence on what is to be restored."""
        wanted = ["disarm"] * self._disarms
        wanted += [f"write {n} {old:g} -> {new:g}" for n, (old, new) in changes.items()]
        if self._owes_mission and _MISSION not in self._left:
            wanted.append("upload the old mission")
        wanted += [f"remove {path}" for path in self._state.scripts]
        if self._changes_mode:
            wanted.append(f"go from {self._command().mode} to {self._state.mode}")
        return wanted

    def _command(self) -> Commands:
        assert self._commands is not None
        return self._commands

    def _try(self, what: str, act: Callable[[], object]) -> None:
        """Run one restore step. Wait once for a silent vehicle and record failures."""
        for _ in range(2):
            try:
                act()
            except LinkLost as error:
                self._differences[what] = str(error)
                if not self._session.outlast(_PATIENCE):
                    return
            except OperatorStopped:
                raise
            except AutotuneError as error:
                self._differences[what] = str(error)
                return
            else:
                self._differences.pop(what, None)
                return

    def _check_neutral(self) -> None:
        """Check from the measured outputs that a vehicle which was disarmed drives no actuator."""
        assert self._firmware is not None
        outputs = read_outputs(self._session, read_servo_map(self._parameters, self._firmware))
        off = {name: force for name, force in outputs.items() if not abs(force) <= _NEUTRAL}
        if off or not outputs:
            shown = ", ".join(f"{n} {f:+.2f} of full output" for n, f in off.items()) or "outputs are not reported"
            raise NotAsFound(f"not neutral ({shown}). Take over by hand", differences=dict.fromkeys(off, "not neutral"))


def _items(told: Sequence[Mapping[str, float]]) -> tuple[MissionItem, ...]:
    return tuple(map(MissionItem.of, told))


def _seconds_since(stamp: str) -> float:
    """Return the seconds since the time *stamp* of a journal entry; 0 without a stamp."""
    try:
        return (datetime.now(UTC) - datetime.fromisoformat(stamp)).total_seconds()
    except (ValueError, TypeError):
        return 0.0


def _check_identity(session: Session, state: JournalState, parameters: Parameters) -> None:
    assert session.vehicle is not None
    strange = difference(state.vehicle, state.fingerprint, session.vehicle, parameters)
    if strange:
        raise WrongVehicle(
            f"the vehicle on this link is not the one recorded in the journal ({strange}). Nothing was written. "
            "Check --connect. If the autopilot board was replaced, run `gcs-autotune params restore` with the run"
        )


def _journal_of(run: Path | None, *, finished: bool = False) -> Path | None:
    """Return the journal of *run* (a directory or journal); of a job the newest one; None: of all runs.

    finished : whether a finished journal counts among several. None if there is no such journal.
    """
    if run is None or (run.is_dir() and not (run / JOURNAL).exists()):
        below = [Path("runs").glob(f"*/{JOURNAL}"), Path("runs").glob(f"*/*/{JOURNAL}")]
        found = itertools.chain(*below) if run is None else run.glob(f"*/{JOURNAL}")  # of a job of several runs
        journals = sorted(found, key=lambda p: p.stat().st_mtime, reverse=True)
        if journals or run is None:
            return next((p for p in journals if finished or not _is_finished(p)), None)
    assert run is not None
    path = run / JOURNAL if run.is_dir() else run
    if not path.exists():
        raise UsageError(f"{path} does not exist. Give a run directory of `gcs-autotune tune`")
    return path


def save_parameters(
    connection: Connection, path: Path, operator: Operator, observer: Observer
) -> tuple[int, int | None]:
    """Save the vehicle's complete parameter list to *path*.

    Return the number of parameters, and the number that differ from the firmware's defaults (None if the vehicle does
    not report these).
    """
    with connect(connection, operator, observer) as session:
        told = len(session.notes)
        found = Parameters(session).read_whole()
        for note in session.notes[told:]:
            observer.say(note)
        changed = len(found.changed) if found.defaults else None
        save_params(path, found.values, comment=f"{session.vehicle}", defaults=found.defaults)
    return len(found.values), changed


def restore_parameters(
    connection: Connection, path: Path, operator: Operator, observer: Observer
) -> dict[str, tuple[float, float]]:
    """Restore the parameters in *path*; return name -> (present, required) of those that differed.

    path : a parameter file, or the directory of a tune, with the parameters of before it.

    Raises
    ------
    BadFile
        The file is not a parameter file.
    OperatorStopped
        The answer was no; nothing was written.
    NotAsFound
        Some parameters could not be restored. The message lists them; the others are restored.
    """
    wanted = load_params(path / SAVED if path.is_dir() else path)
    with connect(connection, operator, observer) as session:
        return _put_back(session, wanted, operator)


def _put_back(session: Session, wanted: Mapping[str, float], operator: Operator) -> dict[str, tuple[float, float]]:
    parameters = Parameters(session)
    found = parameters.read_all(wanted, as_is=True)
    changes = {n: (found[n], v) for n, v in wanted.items() if not same_float32(found[n], v)}
    shown = ", ".join(f"{n} {old:g} -> {new:g}" for n, (old, new) in changes.items())
    if changes and not operator.ask(f"Write {shown}?", session.pump):
        raise OperatorStopped("nothing was written: the answer was no")
    failed: dict[str, str] = {}
    for name, (_, value) in changes.items():
        try:
            parameters.write(name, value)
        except AutotuneError as error:
            failed[name] = str(error)
    if failed:
        raise NotAsFound(
            "could not be restored: " + "; ".join(f"{n}: {why}" for n, why in failed.items()), differences=failed
        )
    return changes
