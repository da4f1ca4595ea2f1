"""Runs of this computer whose journal is open: still running, or interrupted and not restored yet.

A journal may lie anywhere (``--out``), so each open one is noted in the user's state folder, one small file per
journal: ``$XDG_STATE_HOME/gcs-autotune/open`` (``~/.local/state`` without that variable). Journals in ``runs`` of the
working folder are read as well.
"""

from __future__ import annotations

import hashlib
import os
import shlex
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from gcs_autotune.errors import AutotuneError, PreconditionFailed
from gcs_autotune.link import Journal, JournalState, MavlinkCraft, difference, is_being_written
from gcs_autotune.workflow.record import JOURNAL

__all__ = ["OpenRun", "forget_run", "note_run", "open_runs", "refuse_open_runs"]


SIMULATED = ("sitl:", "memory")
"""Prefixes of simulated links. Their vehicle ended with the program, so nothing on it has to be restored."""


@dataclass(frozen=True, slots=True)
class OpenRun:
    """A run directory whose journal is open. ``is_going_on``: whether another program is still executing the run."""

    path: Path
    state: JournalState
    is_going_on: bool

    def __str__(self) -> str:
        debts = ", ".join(f"{name} (was {value:g})" for name, value in self.state.debts.items())
        vehicle = self.state.vehicle.get("firmware", "a vehicle")
        owed = f"{debts} may have trial values" if debts else "its mode or armed state may not be restored"
        how = "is in progress" if self.is_going_on else "was interrupted"
        return f"the run {self.path} on {vehicle} ({self.state.link}) {how}: {owed}"


def _noted() -> Path:
    home = os.environ.get("XDG_STATE_HOME") or str(Path.home() / ".local" / "state")
    return Path(home) / "gcs-autotune" / "open"


def _note_of(journal: Path) -> Path:
    return _noted() / hashlib.sha256(str(journal.absolute()).encode()).hexdigest()[:16]


def note_run(journal: Path) -> None:
    """Register *journal* as open. A state folder that cannot be written does not prevent flying."""
    with suppress(OSError):
        _noted().mkdir(parents=True, exist_ok=True)
        _note_of(journal).write_text(str(journal.absolute()), encoding="utf-8")


def forget_run(journal: Path) -> None:
    """Remove the entry of *journal*, because the run has ended and everything is restored."""
    with suppress(OSError):
        _note_of(journal).unlink(missing_ok=True)


def _journals() -> Iterator[Path]:
    with suppress(OSError):
        for note in sorted(_noted().iterdir()):
            with suppress(OSError, UnicodeDecodeError):
                yield Path(note.read_text(encoding="utf-8").strip())
    for pattern in (f"*/{JOURNAL}", f"*/*/{JOURNAL}"):  # a step of `tune all` is one deeper
        yield from sorted(path.absolute() for path in Path("runs").glob(pattern))


def open_runs() -> list[OpenRun]:
    """Return every run of this computer with an open journal. Remove the entries of missing and closed journals."""
    found: dict[Path, OpenRun] = {}
    for path in _journals():
        try:
            state = Journal.read(path)
        except AutotuneError:
            if not path.exists():
                forget_run(path)
            continue
        if state.is_settled or state.link.startswith(SIMULATED):
            forget_run(path)
        else:
            found[path] = OpenRun(path.parent, state, is_being_written(path))
    return list(found.values())


def refuse_open_runs(craft: MavlinkCraft) -> None:
    """Reject a vehicle on which another run of this computer is open.

    Raises
    ------
    PreconditionFailed
        Such a run is still going on, or was interrupted and not restored.
    """
    vehicle = craft.session.vehicle
    if vehicle is None or craft.session.transport.is_simulated:
        return  # no other run uses a vehicle in this process
    other = craft.other_stations.at_work
    if other:
        raise PreconditionFailed(
            f"another computer is running gcs-autotune on this vehicle: {other}. Wait until that run ends, or "
            "stop it there. Nothing was armed or written"
        )
    for run in open_runs():
        if difference(run.state.vehicle, run.state.fingerprint, vehicle, craft.parameters):
            continue
        cure = (
            "Wait until it ends, or stop it there with Ctrl-C"
            if run.is_going_on
            else f"Run `gcs-autotune restore {shlex.quote(str(run.path))}` first"
        )
        raise PreconditionFailed(f"{run}. {cure}. Nothing was armed or written")
