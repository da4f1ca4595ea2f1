"""The vehicle's parameters to a file the user names, and back."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from gcs_autotune.errors import AutotuneError, NotAsFound, OperatorStopped
from gcs_autotune.link import Parameters, Session, same_float32
from gcs_autotune.mavlink import load_params, save_params
from gcs_autotune.watch import Watcher
from gcs_autotune.workflow.aboard import connect
from gcs_autotune.workflow.operator import Operator
from gcs_autotune.workflow.settings import Connection

__all__ = ["restore_parameters", "save_parameters"]


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
