"""Putting a vehicle back as a run that was cut off had found it, from the run's journal.

Restoring may itself be cut off at any moment and run again: every step looks first and does only what is still to do,
and the journal is settled last.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path

from gcs_autotune.errors import AutotuneError, LinkLost, NotAsFound, OperatorStopped, UsageError, WrongVehicle
from gcs_autotune.firmware import firmware_for, read_servo_map
from gcs_autotune.link import (
    Commands,
    Journal,
    JournalState,
    Parameters,
    Session,
    difference,
    read_outputs,
    same_float32,
)
from gcs_autotune.manoeuvres import DISARMED_ITSELF
from gcs_autotune.mavlink import load_params, save_params
from gcs_autotune.watch import Watcher
from gcs_autotune.workflow.connection import connect
from gcs_autotune.workflow.open_runs import forget_run
from gcs_autotune.workflow.operator import Operator
from gcs_autotune.workflow.record import JOURNAL
from gcs_autotune.workflow.settings import Connection

__all__ = ["is_settled", "link_of", "restore_parameters", "restore_run", "save_parameters"]


_PATIENCE = 30.0
"""Chosen: seconds that restoring waits for a vehicle that has fallen silent."""
_NEUTRAL = 0.03
"""Chosen: fraction of full output that still counts as neutral."""


def link_of(run: Path | None) -> str:
    """Return the connection string that the journal of *run* (directory, a file in one, None: newest) was made on.

    Raises
    ------
    UsageError
        There is no journal to tell.
    """
    folder = run if run is None or run.is_dir() or run.name == JOURNAL else run.parent
    path = _journal_of(folder) if folder is None or folder.name == JOURNAL or (folder / JOURNAL).exists() else None
    link = Journal.read(path).link if path is not None else ""
    if not link:
        raise UsageError("no journal tells which vehicle this belongs to: say with --connect URI")
    return link


def is_settled(run: Path | None) -> bool:
    """Return whether *run* (directory or journal; None: the newest unfinished) left its vehicle as found.

    Raises
    ------
    UsageError
        *run* has no journal.
    """
    path = _journal_of(run)
    return path is None or _is_finished(path)


def _is_finished(path: Path) -> bool:
    return Journal.read(path).is_settled


def restore_run(
    connection: Connection, run: Path | None, operator: Operator, watcher: Watcher
) -> Mapping[str, tuple[float, float]]:
    """Finish the clean-up that *run* (directory or journal; None: the newest unfinished) left open.

    Disarms what was found disarmed, writes each borrowed parameter's old value and reads it back, restores the mode,
    looks whether the outputs are neutral, and settles the journal. Returns name -> (found now, old) of what differed.

    Raises
    ------
    UsageError
        No journal there.
    PreconditionFailed
        The run is still going on in another program, or the disk is full.
    WrongVehicle
        The vehicle on this link is not the one of the journal; nothing is written.
    OperatorStopped
        The answer was no, or Ctrl-C; what is not done yet stays open.
    NotAsFound
        Something could not be put back; the journal stays open for another try.
    """
    path = _journal_of(run)
    if path is None or _is_finished(path):
        return {}
    journal = Journal.resume(path)
    try:
        state = Journal.read(path)
        watcher.say(f"journal {path}: {_owed(state)} still to be put back on {state.vehicle.get('firmware', '?')}")
        with connect(connection, operator, watcher) as session:
            changes = _Restoring(session, state, operator, watcher, journal).run()
        journal.close()
        forget_run(path)
    finally:
        journal.leave()
    return changes


def _owed(state: JournalState) -> str:
    return ", ".join(state.debts) or "no parameter, perhaps the mode or the armed state"


class _Restoring:
    """One restore over one session."""

    def __init__(
        self, session: Session, state: JournalState, operator: Operator, watcher: Watcher, journal: Journal
    ) -> None:
        vehicle = session.vehicle
        assert vehicle is not None
        self._session, self._state, self._operator, self._watcher = session, state, operator, watcher
        self._journal = journal
        self._parameters = Parameters(session)
        _check_identity(session, state, self._parameters)
        self._firmware = firmware_for(vehicle.autopilot, vehicle.vehicle_type)
        self._commands = None if self._firmware is None else Commands(session, self._firmware)
        self._differences: dict[str, str] = {}

    def run(self) -> dict[str, tuple[float, float]]:
        found = self._parameters.read_confirmed(self._state.debts)
        changes = {n: (found[n], v) for n, v in self._state.debts.items() if not same_float32(found[n], v)}
        wanted = self._wanted(changes)
        if wanted and not self._operator.ask(f"As it was found: {' and '.join(wanted)}?", self._session.pump):
            raise OperatorStopped(
                f"nothing was done: {' and '.join(wanted)} was not wanted; the vehicle is as it was left"
            )
        if self._disarms:
            self._try("armed state", self._command().disarm)
        for name, (_, value) in changes.items():
            self._try(name, partial(self._parameters.write, name, value))
        self._put_back_state()
        if not self._differences:
            self._try("mode", self._session.await_heartbeat)  # what restarts meanwhile is in the mode it boots in
        if not self._differences and (self._disarms or self._changes_mode):
            self._watcher.say(f"it is in {self._command().mode} now (restarted?): once more")
            self._put_back_state()
        for name, value in self._state.debts.items():
            if name not in self._differences:
                self._journal.record("returned", name=name, value=value)
        if self._differences:
            shown = "; ".join(f"{what}: {why}" for what, why in self._differences.items())
            raise NotAsFound(
                f"could not be put back: {shown}. Run `gcs-autotune restore` again when that is cured",
                differences=self._differences,
            )
        if wanted:
            self._watcher.say(f"done: {' and '.join(wanted)}; read back and confirmed")
        if self._state.armed and not self._session.armed:
            self._watcher.say(DISARMED_ITSELF)
        return changes

    def _put_back_state(self) -> None:
        """Disarm what was found disarmed, restore the mode, look whether the outputs are neutral."""
        if self._disarms:
            self._try("armed state", self._command().disarm)
        if self._changes_mode:
            self._try("mode", partial(self._command().set_mode, self._state.mode))
        if self._state.armed is False:
            self._try("actuators", self._check_neutral)

    @property
    def _disarms(self) -> bool:
        return self._state.armed is False and self._session.armed

    @property
    def _changes_mode(self) -> bool:
        return bool(self._state.mode) and self._commands is not None and self._commands.mode != self._state.mode

    def _wanted(self, changes: Mapping[str, tuple[float, float]]) -> list[str]:
        """Return in words what is to be done."""
        wanted = ["disarm"] * self._disarms
        wanted += [f"write {n} {old:g} -> {new:g}{self._strange(n, old)}" for n, (old, new) in changes.items()]
        if self._changes_mode:
            wanted.append(f"go from {self._command().mode} to {self._state.mode}")
        return wanted

    def _strange(self, name: str, held: float) -> str:
        ours = any(same_float32(held, value) for value in self._state.written.get(name, ()))
        return "" if ours else " (which is not what the run wrote; somebody else has changed it since)"

    def _command(self) -> Commands:
        assert self._commands is not None
        return self._commands

    def _try(self, what: str, act: Callable[[], object]) -> None:
        """Do it; wait once for a vehicle that falls silent; note what fails."""
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
        """Look at the measured outputs: a vehicle that was found disarmed moves nothing."""
        assert self._firmware is not None
        outputs = read_outputs(self._session, read_servo_map(self._parameters, self._firmware))
        off = {name: force for name, force in outputs.items() if not abs(force) <= _NEUTRAL}
        if off or not outputs:
            shown = ", ".join(f"{n} {f:+.2f} of full output" for n, f in off.items()) or "outputs are not heard"
            raise NotAsFound(f"not neutral ({shown}); take over by hand", differences=dict.fromkeys(off, "not neutral"))


def _check_identity(session: Session, state: JournalState, parameters: Parameters) -> None:
    assert session.vehicle is not None
    strange = difference(state.vehicle, state.fingerprint, session.vehicle, parameters)
    if strange:
        raise WrongVehicle(
            f"the journal is of another vehicle than the one on this link ({strange}); nothing was written. Give the "
            "right --connect; if it is the same hull with another board, `gcs-autotune params restore` with the run's "
            "parameters_before.param asks no questions"
        )


def _journal_of(run: Path | None) -> Path | None:
    if run is None:
        journals = sorted(Path("runs").glob(f"*/{JOURNAL}"), key=lambda p: p.stat().st_mtime, reverse=True)
        return next((p for p in journals if not _is_finished(p)), None)
    path = run / JOURNAL if run.is_dir() else run
    if not path.exists():
        raise UsageError(f"{path} does not exist; name a run directory made by `gcs-autotune tune`")
    return path


def save_parameters(connection: Connection, path: Path, operator: Operator, watcher: Watcher) -> tuple[int, int | None]:
    """Write the vehicle's whole parameter list to *path*; return how many there are, and how many of them are not the
    firmware's defaults (None where it does not tell these)."""
    with connect(connection, operator, watcher) as session:
        told = len(session.notes)
        found = Parameters(session).read_whole()
        for note in session.notes[told:]:
            watcher.say(note)
        changed = len(found.changed) if found.defaults else None
        save_params(path, found.values, comment=f"{session.vehicle}", defaults=found.defaults)
    return len(found.values), changed


def restore_parameters(
    connection: Connection, path: Path, operator: Operator, watcher: Watcher
) -> dict[str, tuple[float, float]]:
    """Put the parameters of *path* back; return name -> (found, wanted) of those that differed.

    Raises
    ------
    BadFile
        The file is no parameter file.
    OperatorStopped
        The answer was no; nothing was written.
    NotAsFound
        Some could not be put back; the message names them, the others are back.
    """
    wanted = load_params(path)
    with connect(connection, operator, watcher) as session:
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
            "could not be put back: " + "; ".join(f"{n}: {why}" for n, why in failed.items()), differences=failed
        )
    return changes
