"""Download, upload and restore of the vehicle's mission, by the MAVLink mission protocol.

An upload is checked by downloading it again. Item 0 is home; the autopilot sets it by itself, so it is not compared.
Source: https://mavlink.io/en/services/mission.html; ArduPilot's ``GCS_MAVLink/MissionItemProtocol``.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, fields
from types import TracebackType
from typing import Any, Self

from gcs_autotune.errors import AutotuneError, LinkError, LinkLost, NoReply, NotAsFound, PreconditionFailed
from gcs_autotune.link.parameters.journal import Journal
from gcs_autotune.link.session import Session
from gcs_autotune.mavlink import Message, enum_name, mavlink

__all__ = [
    "MissionItem",
    "MissionLoan",
    "StoredMission",
    "ask_mission",
    "download",
    "is_ours",
    "read_mission",
    "same_mission",
    "set_current",
    "waypoint",
    "write_mission",
]

_MISSION: int = mavlink.MAV_MISSION_TYPE_MISSION
_ACCEPTED: int = mavlink.MAV_MISSION_ACCEPTED
_PATIENCE, _TRIES = 1.5, 3
_CURRENT = 42
"""Number of MISSION_CURRENT."""
_GIVES_UP = 3.0
"""Silence after which an upload is over [s]: the autopilot requests an item again each second."""
_OUTLAST = 30.0
"""Seconds for which restoring waits for a silent vehicle. Project choice."""
_WITHOUT_INT: Mapping[int, int] = {5: 0, 6: 3, 11: 10}
"""MAV_FRAME of integer positions -> the same frame as ArduPilot reports it."""
_SAME = 1e-4
"""Relative difference up to which parameters are equal: ArduPilot stores some as 16 bits. Project choice."""


@dataclass(frozen=True, slots=True)
class MissionItem:
    """One item as the protocol carries it: MAV_FRAME, MAV_CMD, four parameters, x and y [1e-7 deg] and z [m]."""

    frame: int
    command: int
    param1: float = 0.0
    param2: float = 0.0
    param3: float = 0.0
    param4: float = 0.0
    x: int = 0
    y: int = 0
    z: float = 0.0
    autocontinue: int = 1

    @classmethod
    def of(cls, source: Message | Mapping[str, Any]) -> Self:
        """Return the item of a MISSION_ITEM_INT, or of an entry of a journal."""
        get = source.__getitem__ if isinstance(source, Mapping) else lambda name: getattr(source, name)
        values: dict[str, Any] = {f.name: get(f.name) for f in fields(cls)}
        for name in ("frame", "command", "x", "y", "autocontinue"):
            values[name] = int(values[name])
        numbers: dict[str, Any] = {name: 0.0 if math.isnan(value) else value for name, value in values.items()}
        return cls(**numbers)

    def to_dict(self) -> dict[str, float]:
        """Return its fields, for the journal."""
        return {f.name: getattr(self, f.name) for f in fields(self)}

    def is_like(self, other: MissionItem) -> bool:
        """Return whether both are the same to an autopilot."""
        if (self.command, self.x, self.y) != (other.command, other.x, other.y):
            return False
        placed = bool(self.x or self.y)
        if placed and _WITHOUT_INT.get(self.frame, self.frame) != _WITHOUT_INT.get(other.frame, other.frame):
            return False
        mine, its = self.to_dict(), other.to_dict()
        compared = ("param1", "param2", "param3", "param4", *(["z"] if placed else []))
        return all(math.isclose(mine[n], its[n], rel_tol=_SAME, abs_tol=_SAME) for n in compared)


def waypoint(lat: float, lon: float) -> MissionItem:
    """Return a waypoint at *lat*, *lon* [deg], at the altitude of home."""
    frame: int = mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT
    return MissionItem(frame, mavlink.MAV_CMD_NAV_WAYPOINT, x=round(1e7 * lat), y=round(1e7 * lon))


@dataclass(frozen=True, slots=True)
class StoredMission:
    """The items of a vehicle, with home as item 0, and the number of the ``current`` one."""

    items: tuple[MissionItem, ...] = ()
    current: int = 0

    @property
    def is_empty(self) -> bool:
        """Whether nothing is to be flown."""
        return len(self.items) <= 1


def same_mission(one: Sequence[MissionItem], other: Sequence[MissionItem]) -> bool:
    """Return whether an autopilot would fly both alike; home does not count."""
    if max(len(one), 1) != max(len(other), 1):
        return False
    return all(a.is_like(b) for a, b in zip(one[1:], other[1:], strict=True))


def is_ours(items: Sequence[MissionItem], before: Sequence[MissionItem], ours: Sequence[MissionItem]) -> bool:
    """Return whether *items* is *ours*, or what an interrupted upload leaves of *ours* and *before*.

    ArduPilot replaces a mission item by item as they arrive.
    """
    if same_mission(items, ours):
        return True
    if len(items) <= 1:
        return False
    return all(
        any(k < len(known) and items[k].is_like(known[k]) for known in (ours, before)) for k in range(1, len(items))
    )


def ask_mission(
    session: Session, send: Callable[[], None], name: str, kind: int = _MISSION, seq: int | None = None
) -> Message | None:
    """Send until the vehicle answers with message *name* (of that *kind* and *seq*); None without an answer."""
    heard: list[Message] = []

    def take(message: Message) -> None:
        if getattr(message, "mission_type", kind) == kind and (seq is None or message.seq == seq):
            heard.append(message)

    stop = session.listen(name, take)
    try:
        for _ in range(_TRIES):
            send()
            if session.wait_for(lambda: heard[0] if heard else None, _PATIENCE) is not None:
                return heard[0]
    finally:
        stop()
    return None


def download(session: Session, kind: int = _MISSION) -> list[Message] | None:
    """Return the items of that *kind* (MAV_MISSION_TYPE); None if the vehicle does not answer.

    Raises
    ------
    LinkLost, OperatorStopped
        From the session.
    """
    ids = _ids(session)
    count = ask_mission(
        session, lambda: session.send(mavlink.MAVLink_mission_request_list_message(*ids, kind)), "MISSION_COUNT", kind
    )
    if count is None:
        return None
    items: list[Message] = []
    while len(items) < count.count:
        seq = len(items)
        request = mavlink.MAVLink_mission_request_int_message(*ids, seq, kind)
        item = ask_mission(session, lambda request=request: session.send(request), "MISSION_ITEM_INT", kind, seq)  # type: ignore[misc]
        if item is None:
            return None
        items.append(item)
    session.send(mavlink.MAVLink_mission_ack_message(*ids, _ACCEPTED, kind))
    return items


def read_mission(session: Session) -> StoredMission:
    """Return the vehicle's mission.

    Raises
    ------
    NoReply
        The vehicle does not answer.
    LinkLost, OperatorStopped
        From the session.
    """
    items = next((mission for _ in range(_TRIES) if (mission := download(session)) is not None), None)
    if items is None:
        raise NoReply(f"{session.vehicle} does not report its mission. Try a better link")
    now = ask_mission(session, lambda: session.request_message(_CURRENT), "MISSION_CURRENT")
    return StoredMission(tuple(map(MissionItem.of, items)), 0 if now is None else int(now.seq))


def write_mission(session: Session, mission: StoredMission) -> None:
    """Replace the vehicle's mission, read it back and set its current item; an empty mission clears the vehicle's.

    Raises
    ------
    PreconditionFailed
        The vehicle does not take it, or holds another one afterwards.
    NoReply, LinkLost, OperatorStopped
        The vehicle does not answer, or the operator stopped it.
    """
    ids = _ids(session)
    if mission.is_empty:
        clear = mavlink.MAVLink_mission_clear_all_message(*ids, _MISSION)
        ack = ask_mission(session, lambda: session.send(clear), "MISSION_ACK")
        result = None if ack is None else int(ack.type)
    else:
        result = _upload(session, mission.items)
    if result not in (_ACCEPTED, None):
        raise PreconditionFailed(f"{session.vehicle} rejects the mission ({enum_name('MAV_MISSION_RESULT', result)})")
    stored = read_mission(session)  # the acknowledgement may have been lost
    if not same_mission(stored.items, mission.items):
        if result is None:
            raise NoReply(f"{session.vehicle} does not answer the upload of a mission. Try a better link")
        raise PreconditionFailed(
            f"{session.vehicle} has another mission than the one uploaded. Disconnect other ground stations"
        )
    if not mission.is_empty:
        set_current(session, mission.current)


def set_current(session: Session, seq: int) -> None:
    """Set the current item, from which AUTO continues.

    Raises
    ------
    NoReply
        The vehicle does not confirm it.
    """
    wanted = max(seq, 1)
    order = mavlink.MAVLink_mission_set_current_message(*_ids(session), wanted)
    if ask_mission(session, lambda: session.send(order), "MISSION_CURRENT", seq=wanted) is None:
        raise NoReply(f"{session.vehicle} does not confirm item {wanted} of its mission")


def _upload(session: Session, items: Sequence[MissionItem]) -> int | None:
    """Send *items* as they are requested; return MAV_MISSION_RESULT, None if the vehicle falls silent."""
    ids = _ids(session)
    results: list[int] = []
    requests: list[int] = []

    def answer(message: Message) -> None:
        if message.mission_type != _MISSION or not 0 <= message.seq < len(items):
            return
        requests.append(message.seq)
        item = items[message.seq]
        about = (message.seq, item.frame, item.command, 0, item.autocontinue)
        four = (item.param1, item.param2, item.param3, item.param4)
        session.send(mavlink.MAVLink_mission_item_int_message(*ids, *about, *four, item.x, item.y, item.z, _MISSION))

    def end(message: Message) -> None:
        if message.mission_type == _MISSION:
            results.append(int(message.type))

    stops = [session.listen("MISSION_REQUEST", answer), session.listen("MISSION_REQUEST_INT", answer)]
    stops.append(session.listen("MISSION_ACK", end))
    try:
        for _ in range(_TRIES):
            session.send(mavlink.MAVLink_mission_count_message(*ids, len(items), _MISSION))
            if session.wait_for(lambda: True if requests or results else None, _PATIENCE):
                break
        while requests and not results:
            seen = len(requests)
            if session.wait_for(lambda seen=seen: True if results or len(requests) > seen else None, _GIVES_UP) is None:  # type: ignore[misc]
                break
    finally:
        for stop in stops:
            stop()
    return results[-1] if results else None


def _ids(session: Session) -> tuple[int, int]:
    assert session.vehicle is not None
    return session.vehicle.system, session.vehicle.component


def _check_taken_back(session: Session, own: StoredMission) -> None:
    """Upload the vehicle's *own* mission to it, unchanged.

    Raises
    ------
    PreconditionFailed
        The vehicle does not take it, so it could not be restored after a run.
    NoReply, LinkLost, OperatorStopped
        The vehicle does not answer, or the operator stopped it.
    """
    try:
        write_mission(session, own)
    except PreconditionFailed as error:
        raise PreconditionFailed(
            f"the vehicle's own mission ({len(own.items) - 1} items) could not be restored after the run: {error}. "
            "Save it with a ground station and clear it, then start again"
        ) from error


class MissionLoan:
    """A mission of ours on the vehicle for a while; its own one is in the journal, and restored on every ending.

    A mission that another station uploads in this time stays.

    Parameters
    ----------
    busy : returns why the mission must not be changed now, in words; empty if it may.
    """

    def __init__(self, session: Session, journal: Journal, busy: Callable[[], str] = lambda: "") -> None:
        self._session, self._journal, self._busy = session, journal, busy
        self._before: StoredMission | None = None
        self._ours: StoredMission | None = None

    def set(self, mission: StoredMission) -> None:
        """Store the vehicle's mission in the journal and upload *mission*.

        First the vehicle's own mission is uploaded to it unchanged: what it does not take back is not replaced.

        Raises
        ------
        PreconditionFailed, NoReply, LinkLost, OperatorStopped
            As :func:`write_mission`.
        """
        if self._before is None:
            before = read_mission(self._session)
            if not before.is_empty:
                _check_taken_back(self._session, before)
            self._before = before
        self._journal.record(
            "mission_writing",
            items=[item.to_dict() for item in self._before.items],
            current=self._before.current,
            ours=[item.to_dict() for item in mission.items],
        )
        self._ours = mission
        write_mission(self._session, mission)

    def give_back(self) -> None:
        """Restore the vehicle's own mission. The operator has to wait; a silent vehicle is waited for once.

        Raises
        ------
        NotAsFound
            It could not be restored; the journal has it.
        """
        before, ours = self._before, self._ours
        if before is None or ours is None:
            return
        with self._session.operator.shielded():
            for attempt in range(2):
                try:
                    why = self._busy() or self._restored(before, ours)
                except (LinkError, AutotuneError) as error:
                    why = str(error)
                    if attempt or not (isinstance(error, LinkLost) and self._session.outlast(_OUTLAST)):
                        break
                else:
                    break
        if why:
            raise NotAsFound(
                f"the vehicle's mission could not be restored ({why}). It is in {self._journal.path}. Run "
                "`gcs-autotune restore` with it",
                differences={"mission": why},
            )
        self._ours = None
        with suppress(PreconditionFailed):  # a full disk: the journal only lists too much then
            self._journal.record("mission_returned")

    def rewind(self) -> None:
        """Set the current item of a mission that has been restored; ``NoReply`` if the vehicle does not confirm it."""
        if self._ours is None and self._before is not None and not self._before.is_empty and self._before.current:
            set_current(self._session, self._before.current)

    def _restored(self, before: StoredMission, ours: StoredMission) -> str:
        mission = read_mission(self._session)
        if same_mission(mission.items, before.items) and not same_mission(mission.items, ours.items):
            return ""
        if not is_ours(mission.items, before.items, ours.items):
            self._session.notes.append("the mission stays as another station uploaded it during the run")
            return ""
        write_mission(self._session, before)
        return ""

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            self.give_back()
        except NotAsFound as failure:
            if error is None:
                raise
            raise NotAsFound(f"{error}. Also, {failure}", differences=failure.differences) from error
