"""What was borrowed from the vehicle, on disk before the first write, so that a power cut loses nothing.

JSON lines, each forced to the disk before the next step. Events in order: ``opened`` (vehicle, link, mode,
armed), ``lent`` (name, value), ``writing`` (name, value), ``written`` (name, value), then ``kept`` (values) or
``returned`` (name, value), and ``closed``.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from gcs_autotune.errors import BadFile, PreconditionFailed
from gcs_autotune.link.identity import VehicleIdentity

__all__ = ["Journal", "JournalState"]

SCHEMA = 1


def _wall_stamp() -> str:
    return datetime.now(UTC).isoformat(timespec="milliseconds")


@dataclass(frozen=True, slots=True)
class JournalState:
    """What a journal says: whom it is about, how it was found, and what is still owed (name -> old value)."""

    vehicle: Mapping[str, Any] = field(default_factory=dict)
    link: str = ""
    mode: str = ""
    armed: bool | None = None
    debts: Mapping[str, float] = field(default_factory=dict)
    closed: bool = False


class Journal:
    """Writes a journal.

    Parameters
    ----------
    path : the file; created, or appended to.
    vehicle, link, mode, armed : how things were found, for whoever restores later.
    stamp : the time to write beside each event.

    Raises
    ------
    PreconditionFailed
        When the file cannot be written; then no parameter may be changed.
    """

    def __init__(
        self,
        path: Path,
        *,
        vehicle: VehicleIdentity | None = None,
        link: str = "",
        mode: str = "",
        armed: bool | None = None,
        stamp: Callable[[], str] = _wall_stamp,
    ) -> None:
        self._path = path
        self._stamp = stamp
        try:
            self._descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o644)
        except OSError as error:
            raise self._unwritable(error) from error
        self.record(
            "opened",
            schema=SCHEMA,
            vehicle=vehicle.to_dict() if vehicle else {},
            link=link,
            mode=mode,
            armed=armed,
        )
        _sync_folder(path.parent)

    @property
    def path(self) -> Path:
        """Where it is."""
        return self._path

    def record(self, event: str, **details: Any) -> None:
        """Append one event and force it to the disk.

        Raises
        ------
        PreconditionFailed
            When it cannot be written (a full disk, say).
        """
        line = json.dumps({"event": event, "time": self._stamp(), **details}) + "\n"
        data = line.encode()
        try:
            if os.write(self._descriptor, data) != len(data):
                raise OSError("the line was cut short; the disk is full")
            os.fsync(self._descriptor)
        except OSError as error:
            raise self._unwritable(error) from error

    def close(self) -> None:
        """Record that we are done, and close the file."""
        try:
            self.record("closed")
        finally:
            os.close(self._descriptor)

    def _unwritable(self, error: OSError) -> PreconditionFailed:
        return PreconditionFailed(
            f"the journal {self._path} cannot be written ({error.strerror or error}), so no parameter may be "
            "changed: free some disk space or choose another folder"
        )

    @staticmethod
    def open_debts(path: Path) -> dict[str, float]:
        """Return name -> old value of everything written and neither returned nor kept."""
        return dict(Journal.read(path).debts)

    @staticmethod
    def read(path: Path) -> JournalState:
        """Return what the journal at *path* says; a last line cut short by a power cut is ignored.

        Raises
        ------
        BadFile
            When it cannot be read, or a line before the last is damaged.
        """
        return _replay(path, _events(path))


def _events(path: Path) -> list[dict[str, Any]]:
    try:
        lines = path.read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError as error:
        raise BadFile(f"the journal {path} cannot be read: {error.strerror}") from error
    events: list[dict[str, Any]] = []
    for number, line in enumerate(lines, start=1):
        try:
            event = json.loads(line)
            if not isinstance(event, dict) or "event" not in event:
                raise ValueError("not an event")
            events.append(event)
        except ValueError as error:
            if number == len(lines):
                break
            raise BadFile(f"the journal {path}, line {number}, is damaged: {error}") from error
    return events


def _replay(path: Path, events: list[dict[str, Any]]) -> JournalState:
    head: dict[str, Any] = {}
    lent: dict[str, float] = {}
    debts: dict[str, float] = {}
    closed = False
    try:
        for event in events:
            closed = event["event"] == "closed"
            match event["event"]:
                case "opened":
                    head = head or event
                case "lent":
                    lent[event["name"]] = float(event["value"])
                case "writing":
                    debts.setdefault(event["name"], lent[event["name"]])
                case "returned":
                    debts.pop(event["name"], None)
                case "kept":
                    for name in event["values"]:
                        debts.pop(name, None)
    except (KeyError, TypeError, ValueError) as error:
        raise BadFile(f"the journal {path} holds an event that makes no sense: {error!r}") from error
    known = {key: head[key] for key in ("vehicle", "link", "mode", "armed") if key in head}
    return JournalState(**known, debts=debts, closed=closed)


def _sync_folder(folder: Path) -> None:
    """Make the new file's name itself survive a power cut, where the system can."""
    if os.name != "posix":
        return
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
