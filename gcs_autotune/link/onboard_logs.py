"""Download the vehicle's logs with LOG_REQUEST_LIST and LOG_REQUEST_DATA; ArduPilot sends logs only while disarmed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from gcs_autotune.errors import BadFile, NoReply
from gcs_autotune.link.session import Session
from gcs_autotune.mavlink import Message, mavlink

__all__ = ["OnboardLog", "fetch_log", "list_logs"]

_PIECE = 90
"""Bytes in one LOG_DATA."""
_STRETCH = 128 * _PIECE
"""Number of bytes requested at once, a few seconds on a slow radio. Project choice."""
_QUIET = 1.0
"""Seconds without new data after which missing data is requested again. Project choice."""
_TRIES = 5
_LARGEST = 1 << 30
"""Largest log that is downloaded [bytes]. Project choice."""


@dataclass(frozen=True, slots=True)
class OnboardLog:
    """An onboard log: number, size [bytes], start time [s since 1970; 0: unknown]."""

    number: int
    size: int
    utc: float


def list_logs(session: Session) -> tuple[OnboardLog, ...]:
    """Return the onboard logs, oldest first.

    Raises
    ------
    NoReply
        The vehicle does not answer.
    """
    entries: dict[int, OnboardLog] = {}
    counts: list[int] = []

    def hear(message: Message) -> None:
        counts.append(int(message.num_logs))
        if message.num_logs:
            entries[int(message.id)] = OnboardLog(int(message.id), int(message.size), float(message.time_utc))

    stop = session.listen("LOG_ENTRY", hear)
    try:
        for _ in range(_TRIES):
            _ask_list(session)
            while session.wait_for(_more(entries, counts), _QUIET):
                if counts and len(entries) >= counts[-1]:
                    return tuple(entries[n] for n in sorted(entries))
    finally:
        stop()
    listed = f"listed only {len(entries)} of its {counts[-1]} logs" if counts else "did not list its logs"
    raise NoReply(f"{session.vehicle} {listed}. Disarm the vehicle: it sends logs only when disarmed")


def _more(entries: dict[int, OnboardLog], counts: list[int]) -> Callable[[], bool | None]:
    before = len(counts)
    return lambda: True if len(counts) > before else None


def _ids(session: Session) -> tuple[int, int]:
    if session.vehicle is None:
        raise NoReply("logs were requested before a vehicle was discovered. Discover a vehicle first")
    return session.vehicle.system, session.vehicle.component


def _ask_list(session: Session) -> None:
    session.send(mavlink.MAVLink_log_request_list_message(*_ids(session), 0, 0xFFFF))


def fetch_log(
    session: Session, log: OnboardLog, progress: Callable[[int, int], object] = lambda done, whole: None
) -> bytes:
    """Return the bytes of *log*; ``progress(done, size)`` is called as they arrive.

    Raises
    ------
    NoReply
        The data stopped arriving. BadFile: the log is too large. OperatorStopped: the operator stopped the download.
    """
    if log.size > _LARGEST:
        raise BadFile(f"log {log.number} has {log.size} bytes, too many for the link. Copy the log from the SD card")
    data, missing = bytearray(log.size), set(range(0, log.size, _PIECE))

    def hear(message: Message) -> None:
        offset, count = int(message.ofs), int(message.count)
        if message.id == log.number and offset in missing and count == min(_PIECE, log.size - offset):
            data[offset : offset + count] = bytes(message.data[:count])
            missing.discard(offset)

    stop = session.listen("LOG_DATA", hear)
    silent = 0
    try:
        while missing:
            first, before = min(missing), len(missing)
            wanted = {o for o in range(first, min(first + _STRETCH, log.size), _PIECE) if o in missing}
            count = min(max(wanted) + _PIECE, log.size) - first
            session.send(mavlink.MAVLink_log_request_data_message(*_ids(session), log.number, first, count))
            while not wanted.isdisjoint(missing) and session.wait_for(_fewer(missing), _QUIET):
                progress(log.size - _PIECE * len(missing), log.size)
            silent = silent + 1 if len(missing) == before else 0
            if silent == _TRIES:
                raise NoReply(
                    f"{session.vehicle} stopped sending log {log.number}. Disarm the vehicle: it sends logs only when "
                    "disarmed"
                )
        return bytes(data)
    finally:
        stop()
        session.send(mavlink.MAVLink_log_request_end_message(*_ids(session)))


def _fewer(missing: set[int]) -> Callable[[], bool | None]:
    before = len(missing)
    return lambda: True if len(missing) < before else None
