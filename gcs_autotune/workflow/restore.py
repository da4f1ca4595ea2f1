"""Putting parameters back: from a file the user names, or from the journal of a run that was cut off."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from gcs_autotune.errors import AutotuneError, NotAsFound, OperatorStopped, UsageError, WrongVehicle
from gcs_autotune.firmware import firmware_for
from gcs_autotune.link import (
    Commands,
    Journal,
    JournalState,
    Parameters,
    Session,
    load_params,
    same_float32,
    save_params,
)
from gcs_autotune.watch import Watcher
from gcs_autotune.workflow.aboard import connect
from gcs_autotune.workflow.operator import Operator
from gcs_autotune.workflow.record import JOURNAL
from gcs_autotune.workflow.settings import Connection

__all__ = ["is_settled", "link_of", "restore_parameters", "restore_run", "save_parameters"]


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
    state = Journal.read(path)
    return state.closed and not state.debts


def save_parameters(connection: Connection, path: Path, operator: Operator, watcher: Watcher) -> int:
    """Write the vehicle's whole parameter list to *path*; return how many there are."""
    with connect(connection, operator, watcher) as session:
        values = Parameters(session).read_full()
        save_params(path, values, comment=f"{session.vehicle}")
    return len(values)


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


def restore_run(
    connection: Connection, run: Path | None, operator: Operator, watcher: Watcher
) -> Mapping[str, tuple[float, float]]:
    """Finish the clean-up that *run* (directory or journal; None: the newest unfinished) left open.

    Writes each borrowed parameter's old value and reads it back, disarms what was found disarmed, restores the mode,
    and settles the journal.

    Raises
    ------
    UsageError
        No journal there.
    WrongVehicle
        The vehicle on this link is not the one of the journal; nothing is written.
    NotAsFound
        Some parameter could not be put back; the journal stays open for another try.
    """
    path = _journal_of(run)
    if path is None or _is_finished(path):
        return {}
    state = Journal.read(path)
    owed = ", ".join(state.debts) or "no parameter"
    watcher.say(f"journal {path}: {owed} still to be put back on {state.vehicle.get('firmware', '?')}")
    with connect(connection, operator, watcher) as session:
        _check_identity(session, state)
        changes = _put_back(session, state.debts, operator)
        _put_state_back(session, state, operator, watcher)
        journal = Journal(path)
        for name, value in state.debts.items():
            journal.record("returned", name=name, value=value)
        journal.close()
    return changes


def _check_identity(session: Session, state: JournalState) -> None:
    vehicle = session.vehicle
    assert vehicle is not None
    known = {key: state.vehicle.get(key) for key in ("system", "autopilot", "vehicle_type")}
    found = {key: vehicle.to_dict()[key] for key in known}
    if known != found:
        raise WrongVehicle(
            f"the journal is of another vehicle ({known}) than the one on this link ({found}); nothing was written. "
            "Give the right --connect"
        )


def _put_state_back(session: Session, state: JournalState, operator: Operator, watcher: Watcher) -> None:
    """Disarm if it was found disarmed, and go back to the mode it was found in."""
    vehicle = session.vehicle
    assert vehicle is not None
    firmware = firmware_for(vehicle.autopilot, vehicle.vehicle_type)
    if firmware is None:
        return
    commands = Commands(session, firmware)
    disarms = state.armed is False and session.armed
    changes_mode = bool(state.mode) and commands.mode != state.mode
    wanted = " and ".join(["disarm"] * disarms + [f"go from {commands.mode} to {state.mode}"] * changes_mode)
    if not wanted:
        return
    if not operator.ask(f"As it was found: {wanted}?", session.pump):
        raise OperatorStopped(f"the vehicle was left as it is, not as found: {wanted} was not wanted")
    if disarms:
        commands.disarm()
    if changes_mode:
        commands.set_mode(state.mode)
    watcher.say(f"done: {wanted}")


def _put_back(session: Session, wanted: Mapping[str, float], operator: Operator) -> dict[str, tuple[float, float]]:
    parameters = Parameters(session)
    found = parameters.read_all(wanted)
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


def _journal_of(run: Path | None) -> Path | None:
    if run is None:
        journals = sorted(Path("runs").glob(f"*/{JOURNAL}"), key=lambda p: p.stat().st_mtime, reverse=True)
        return next((p for p in journals if not _is_finished(p)), None)
    path = run / JOURNAL if run.is_dir() else run
    if not path.exists():
        raise UsageError(f"{path} does not exist; name a run directory made by `gcs-autotune tune`")
    return path
