"""Journal of temporary changes on the vehicle, written to disk before each change so that a power loss loses
nothing.

The file consists of JSON lines, each synced to disk before the next step. The events are, in order: ``opened``
(vehicle, link, mode, armed, fingerprint), ``lent`` (name, value), ``writing`` (name, value), ``written`` (name, value),
then ``kept`` (values) or ``returned`` (name, value), and ``closed``. ``script_writing`` and ``script_removed`` (path)
enclose the time in which a Lua script of ours may be on the vehicle. A restore that continues the journal adds
``resumed``.

Commands for mode and arming are recorded too: ``ordering`` (mode or armed, the vehicle's time since boot) before the
command, and ``ordered`` once the vehicle shows it. ``yielded`` (mode or armed) means that another operator has
commanded something else.

The writer locks the file; the system releases the lock when the program ends in any way. The reader accepts a truncated
last line.
"""

from __future__ import annotations

import errno
import json
import os
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from msgspec import Meta, Struct

from gcs_autotune.errors import BadFile, PreconditionFailed
from gcs_autotune.mavlink import VehicleIdentity
from gcs_autotune_files import Refused, clipped, conform, parse

__all__ = ["Journal", "JournalState", "good_length", "is_being_written", "read_journal"]


@dataclass(frozen=True, slots=True)
class JournalState:
    """The state recorded in a journal.

    ``vehicle``, ``link``, ``mode``, ``armed``, ``fingerprint`` : the original state. ``debts`` : name -> old value of
    parameters written and neither restored nor kept. ``written`` : name -> the values that this program wrote.
    ``opened`` is False if not even the first line reached the disk; then nothing was changed.

    ``left_in`` : modes that this program may have left the vehicle in: the last one commanded, and the previous one if
    that is not confirmed. It is empty once another operator has commanded a mode. ``armed_by_us`` : whether a command
    of this program may have armed the vehicle. ``boot`` [s] and ``stamp`` : the vehicle's time since boot and our time
    at the last command; None and empty if unknown.
    ``mission`` : the vehicle's own ``items`` and ``current`` item, and ``ours`` that replaced them; None once restored.
    ``scripts`` : paths of Lua scripts of this program on the vehicle that are not removed yet.
    """

    vehicle: Mapping[str, Any] = field(default_factory=dict)
    link: str = ""
    mode: str = ""
    armed: bool | None = None
    fingerprint: Mapping[str, float] = field(default_factory=dict)
    debts: Mapping[str, float] = field(default_factory=dict)
    written: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    closed: bool = False
    opened: bool = False
    left_in: tuple[str, ...] = ()
    armed_by_us: bool = False
    boot: float | None = None
    stamp: str = ""
    mission: Mapping[str, Any] | None = None
    scripts: tuple[str, ...] = ()

    @property
    def is_settled(self) -> bool:
        """Whether nothing is left to restore."""
        return not self.opened or (self.closed and not self.debts and self.mission is None and not self.scripts)


def read_journal(path: Path) -> JournalState:
    """Return the state recorded in the journal at *path*; damage at its end, as after a power cut, is ignored.

    Raises
    ------
    BadFile
        The file cannot be read, or is damaged before its end.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise BadFile(f"the journal {path} cannot be read: {error.strerror}") from error
    lines = data.split(b"\n")
    events = [_event(line) for line in lines]
    last = max((i for i, event in enumerate(events) if event is not None), default=-1)
    for number, (line, event) in enumerate(zip(lines[: last + 1], events, strict=False), start=1):
        if event is None and line.strip():
            raise BadFile(
                f"the journal {path}, line {number}, is damaged. Restore the old values with `gcs-autotune params "
                "restore` and the parameters_before.param of the same directory"
            )
    return _replay(path, [event for event in events if event is not None])


def good_length(data: bytes) -> int:
    """Return the number of bytes of *data* up to the end of its last complete line."""
    good = position = 0
    for line in data.split(b"\n"):
        position += len(line)
        if _event(line) is not None:
            good = min(position + 1, len(data))
        position += 1
    return good


def _event(line: bytes) -> dict[str, Any] | None:
    """Return the event in a line; None if the line is damaged or empty."""
    try:
        event = parse(line)
    except Refused:
        return None
    return event if isinstance(event, dict) and isinstance(event.get("event"), str) else None


Value = Annotated[float, Meta(ge=-3.4028235e38, le=3.4028235e38)]
Name = Annotated[str, Meta(pattern="^[A-Za-z_][A-Za-z0-9_]{0,15}$")]


class _Opened(Struct, frozen=True, tag_field="event", tag="opened"):
    vehicle: dict[str, int | str | None] = {}
    link: str = ""
    mode: str = ""
    armed: bool | None = None
    fingerprint: dict[Name, Value] = {}
    schema: Literal[1] = 1


class _Lent(Struct, frozen=True, tag_field="event", tag="lent"):
    name: Name
    value: Value


class _Writing(Struct, frozen=True, tag_field="event", tag="writing"):
    name: Name
    value: Value


class _Written(Struct, frozen=True, tag_field="event", tag="written"):
    name: Name
    value: Value


class _Returned(Struct, frozen=True, tag_field="event", tag="returned"):
    name: Name
    value: Value | None = None


class _Kept(Struct, frozen=True, tag_field="event", tag="kept"):
    values: dict[Name, Value]


Items = list[dict[str, Value]]


class _MissionWriting(Struct, frozen=True, tag_field="event", tag="mission_writing"):
    items: Items
    ours: Items
    current: int = 0


class _MissionReturned(Struct, frozen=True, tag_field="event", tag="mission_returned"):
    pass


RemotePath = Annotated[str, Meta(pattern="^[A-Za-z0-9_./-]{1,120}$")]


class _ScriptWriting(Struct, frozen=True, tag_field="event", tag="script_writing"):
    path: RemotePath


class _ScriptRemoved(Struct, frozen=True, tag_field="event", tag="script_removed"):
    path: RemotePath


class _Closed(Struct, frozen=True, tag_field="event", tag="closed"):
    pass


class _Resumed(Struct, frozen=True, tag_field="event", tag="resumed"):
    pass


class _Ordering(Struct, frozen=True, tag_field="event", tag="ordering"):
    mode: str | None = None
    armed: bool | None = None
    boot: Value | None = None
    time: str = ""


class _Ordered(Struct, frozen=True, tag_field="event", tag="ordered"):
    mode: str | None = None
    armed: bool | None = None


class _Yielded(Struct, frozen=True, tag_field="event", tag="yielded"):
    mode: str | None = None
    armed: bool | None = None


_Event = (
    _Opened
    | _Lent
    | _Writing
    | _Written
    | _Returned
    | _Kept
    | _MissionWriting
    | _MissionReturned
    | _ScriptWriting
    | _ScriptRemoved
    | _Closed
    | _Resumed
    | _Ordering
    | _Ordered
    | _Yielded
)


@dataclass(slots=True)
class _Orders:
    """State of this program's commands according to the events read so far."""

    modes: tuple[str, ...] = ()
    armed: bool = False
    boot: float | None = None
    stamp: str = ""

    def take(self, event: _Ordering | _Ordered | _Yielded) -> None:
        """Update the recorded state with *event*."""
        match event:
            case _Ordering():
                self.boot, self.stamp = event.boot, event.time
                self.armed = self.armed or bool(event.armed)
                self.modes = self.modes if event.mode is None else (*self.modes, event.mode)
            case _Ordered():
                self.armed = self.armed if event.armed is None else event.armed
                self.modes = self.modes if event.mode is None else (event.mode,)
            case _Yielded():
                self.armed = self.armed and event.armed is None
                self.modes = self.modes if event.mode is None else ()


def _replay(path: Path, events: list[dict[str, Any]]) -> JournalState:
    head: _Opened | None = None
    lent: dict[str, float] = {}
    debts: dict[str, float] = {}
    written: dict[str, tuple[float, ...]] = {}
    mission: dict[str, Any] | None = None
    scripts: dict[str, None] = {}
    closed = False
    orders = _Orders()
    try:
        for entry in events:
            event: _Event = conform(entry, _Event)  # type: ignore[arg-type]
            closed = isinstance(event, _Closed)
            match event:
                case _Opened():
                    head = head or event
                    orders = orders if orders.modes else _Orders((head.mode,))
                case _Closed() | _Resumed():
                    pass
                case _ if head is None:
                    raise Refused("the journal does not start with the original state")
                case _Ordering() | _Ordered() | _Yielded():
                    orders.take(event)
                case _Lent():
                    lent[event.name] = event.value
                case _Writing():
                    if event.name not in lent:
                        raise Refused(f"{event.name} is written, but no event has its original value")
                    debts.setdefault(event.name, lent[event.name])
                    written[event.name] = (*written.get(event.name, ()), event.value)
                case _MissionWriting():
                    mission = mission or {"items": event.items, "current": event.current}
                    mission = {**mission, "ours": event.ours}
                case _MissionReturned():
                    mission = None
                case _ScriptWriting():
                    scripts[event.path] = None
                case _ScriptRemoved():
                    scripts.pop(event.path, None)
                case _Returned():
                    debts.pop(event.name, None)
                    written.pop(event.name, None)
                case _Kept():
                    for name in event.values:
                        debts.pop(name, None)
                        written.pop(name, None)
    except Refused as error:
        raise BadFile(f"the journal {path} has an invalid event '{clipped(entry['event'])}': {error}") from error
    if head is None:
        return JournalState(closed=closed)
    return JournalState(
        head.vehicle,
        head.link,
        head.mode,
        head.armed,
        head.fingerprint,
        debts,
        written,
        closed,
        opened=True,
        left_in=orders.modes,
        armed_by_us=orders.armed,
        boot=orders.boot,
        stamp=orders.stamp,
        mission=mission,
        scripts=tuple(scripts),
    )


try:
    import fcntl
except ImportError:  # pragma: no cover - Windows has neither locks of this kind nor folders to force
    fcntl = None  # type: ignore[assignment]


SCHEMA = 1
_ANCESTORS = 3
"""Number of parent folders that are synced to disk: the run's folder and those created for it."""


def _wall_stamp() -> str:
    return datetime.now(UTC).isoformat(timespec="milliseconds")


class Journal:
    """Writes a journal.

    Parameters
    ----------
    path : the file; created, or appended to.
    vehicle, link, mode, armed : the original state, for a later restore.
    fingerprint : parameters to recognise the vehicle by if it has no unique id.
    stamp : function that returns the time to write with each event.

    Raises
    ------
    PreconditionFailed
        The file cannot be written, or another program is writing it. Then no parameter may be changed.
    """

    def __init__(
        self,
        path: Path,
        *,
        vehicle: VehicleIdentity | None = None,
        link: str = "",
        mode: str = "",
        armed: bool | None = None,
        fingerprint: Mapping[str, float] | None = None,
        stamp: Callable[[], str] = _wall_stamp,
    ) -> None:
        self._open(path, stamp)
        try:
            self.record(
                "opened",
                schema=SCHEMA,
                vehicle=vehicle.to_dict() if vehicle else {},
                link=link,
                mode=mode,
                armed=armed,
                fingerprint=dict(fingerprint or {}),
            )
            _sync_folders(path)
        except BaseException:
            self.leave()
            raise

    @classmethod
    def resume(cls, path: Path, stamp: Callable[[], str] = _wall_stamp) -> Self:
        """Continue the journal of an interrupted run; a truncated last line is removed.

        Raises
        ------
        PreconditionFailed
            The run is still going on in another program, or the file cannot be written.
        BadFile
            The file is damaged before its end.
        """
        read_journal(path)
        journal = cls.__new__(cls)
        journal._open(path, stamp)
        try:
            journal._mend()
            journal.record("resumed")
        except BaseException:
            journal.leave()
            raise
        return journal

    def _open(self, path: Path, stamp: Callable[[], str]) -> None:
        self._path = path
        self._stamp = stamp
        try:
            self._descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_APPEND, 0o644)
        except OSError as error:
            raise self._unwritable(error) from error
        if fcntl is None:
            return
        try:
            fcntl.flock(self._descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            self.leave()
            if error.errno in (errno.EACCES, errno.EAGAIN):
                raise PreconditionFailed(
                    f"the journal {path} is in use: its run is still in progress. "
                    "Stop that run first (Ctrl-C restores the vehicle)"
                ) from error
            raise self._unwritable(error) from error

    def _mend(self) -> None:
        """Remove a truncated last line. If the line lacks only its line end, complete it."""
        try:
            data = self._path.read_bytes()
            length = good_length(data)
            if length < len(data):
                os.ftruncate(self._descriptor, length)
            if length and data[length - 1 : length] != b"\n":
                os.write(self._descriptor, b"\n")
            _sync(self._descriptor)
        except OSError as error:
            raise self._unwritable(error) from error

    @property
    def path(self) -> Path:
        """Path of the journal."""
        return self._path

    def record(self, event: str, **details: Any) -> None:
        """Append one event and sync it to disk, completely or not at all.

        Raises
        ------
        PreconditionFailed
            The event cannot be written (e.g. the disk is full).
        """
        line = json.dumps({"event": event, "time": self._stamp(), **details}) + "\n"
        data = line.encode()
        try:
            end = os.fstat(self._descriptor).st_size
            try:
                if os.write(self._descriptor, data) != len(data):
                    raise OSError(errno.ENOSPC, "the line was truncated: the disk is full")
                _sync(self._descriptor)
            except OSError:
                with suppress(OSError):
                    os.ftruncate(self._descriptor, end)
                raise
        except OSError as error:
            raise self._unwritable(error) from error

    def close(self) -> None:
        """Record the ``closed`` event and close the file."""
        try:
            self.record("closed")
        finally:
            self.leave()

    def leave(self) -> None:
        """Close the file without a ``closed`` event, so that ``gcs-autotune restore`` can restore the rest.

        It may be called twice.
        """
        descriptor, self._descriptor = self._descriptor, -1
        if descriptor >= 0:
            os.close(descriptor)

    def _unwritable(self, error: OSError) -> PreconditionFailed:
        return PreconditionFailed(
            f"the journal {self._path} cannot be written ({error.strerror or error}), so no parameter may be "
            "changed. Free some disk space or choose another folder"
        )

    @staticmethod
    def open_debts(path: Path) -> dict[str, float]:
        """Return name -> old value of everything written but neither restored nor kept."""
        return dict(read_journal(path).debts)

    @staticmethod
    def read(path: Path) -> JournalState:
        """Return the state recorded in the journal at *path*; a truncated last line is ignored.

        Raises
        ------
        BadFile
            The file cannot be read, or is damaged before its end.
        """
        return read_journal(path)


def is_being_written(path: Path) -> bool:
    """Return whether another program is writing the journal at *path*; False where locks are unsupported."""
    if fcntl is None:
        return False
    try:
        descriptor = os.open(path, os.O_RDONLY)
    except OSError:
        return False
    try:
        fcntl.flock(descriptor, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except OSError as error:
        return error.errno in (errno.EACCES, errno.EAGAIN)
    finally:
        os.close(descriptor)
    return False


def _sync(descriptor: int) -> None:
    os.fsync(descriptor)
    full = getattr(fcntl, "F_FULLFSYNC", None)
    if full is not None:  # pragma: no cover - macOS: only this reaches the platter
        fcntl.fcntl(descriptor, full)


def _sync_folders(path: Path) -> None:
    """Sync the new file's name and its folders to disk, where the system supports it."""
    if os.name != "posix":
        return
    for folder in list(path.absolute().parents)[:_ANCESTORS]:
        with suppress(OSError):
            descriptor = os.open(folder, os.O_RDONLY)
            try:
                os.fsync(descriptor)
            finally:
                os.close(descriptor)
