"""Read, write and remove a file on the vehicle by MAVLink FTP.

A few blocks are requested or sent at a time, by offset, so that a lost block can be repeated. A file that is read ends
with a short block or with the reply "end of file". A file that was written is verified by its checksum.
"""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass
from functools import partial

from gcs_autotune.clock import Deadline
from gcs_autotune.errors import BadFile, NoReply
from gcs_autotune.link.session import Session
from gcs_autotune.mavlink import Message, mavlink

__all__ = ["has_remote_folder", "read_remote_file", "remove_remote_file", "write_remote_file"]

_HEAD = struct.Struct("<HBBBBBBI")
_TERMINATE, _LIST, _OPEN, _READ = 1, 3, 4, 5
_CREATE, _WRITE, _REMOVE, _CHECKSUM = 6, 7, 8, 14
_ACK, _NACK = 128, 129
_ERRNO, _END_OF_FILE, _NOT_FOUND = 2, 6, 10
_ENOENT = 2
_PIECE, _PAYLOAD = 239, 251
_ABREAST = 5
"""Number of pieces requested at once, about what the buffer of a slow radio can store. Project choice."""
_REPLY = 1.0
"""Seconds after which a request is repeated. Project choice."""
_TRIES = 3
_LONGEST = 1 << 20
"""Largest file that is read [bytes]. Project choice."""
_ERRORS = {
    1: "it failed",
    4: "the file session was lost",
    5: "the vehicle has no free file session",
    2: "the file system rejects it",
    7: "the vehicle does not support the request",
    9: "the file is write-protected",
    10: "the file does not exist",
}


@dataclass(frozen=True, slots=True)
class _Reply:
    sequence: int
    is_ack: bool
    request: int
    offset: int
    data: bytes


class _Exchange:
    """Requests of one FTP session and their replies."""

    def __init__(self, session: Session) -> None:
        self._session = session
        # A vehicle answers a number that it has seen last with the same reply, so another exchange has other numbers.
        self._sequence = round(1e3 * session.clock.now()) & 0xFFFF
        self.replies: list[_Reply] = []
        self._stop = session.listen("FILE_TRANSFER_PROTOCOL", self._on_reply)

    def close(self) -> None:
        self._stop()

    def ask(self, opcode: int, *, offset: int = 0, size: int = 0, data: bytes = b"", is_repeated: bool = False) -> None:
        """Send a request. A repeated one has the number of the last, so that the vehicle executes it once only."""
        vehicle = self._session.vehicle
        if vehicle is None:
            raise NoReply("a file was requested before a vehicle was discovered. Discover a vehicle first")
        self._sequence = (self._sequence + (not is_repeated)) & 0xFFFF
        head = _HEAD.pack(self._sequence, 0, opcode, size or len(data), 0, 0, 0, offset)
        payload = (head + data).ljust(_PAYLOAD, b"\0")
        self._session.send(
            mavlink.MAVLink_file_transfer_protocol_message(0, vehicle.system, vehicle.component, payload)
        )

    def _on_reply(self, message: Message) -> None:
        raw = bytes(message.payload)
        sequence, _, opcode, size, request, _, _, offset = _HEAD.unpack_from(raw)
        if opcode in (_ACK, _NACK) and size <= _PIECE:
            data = raw[_HEAD.size : _HEAD.size + size]
            self.replies.append(_Reply(sequence, opcode == _ACK, request, offset, data))

    def has(self, count: int) -> bool | None:
        """Return True if at least *count* replies have arrived, else None."""
        return True if len(self.replies) >= count else None

    def answer(self, opcode: int, data: bytes = b"") -> _Reply:
        """Send a request with *opcode* and *data*, repeated until it is answered, and return the answer.

        Raises
        ------
        NoReply
            The request was not answered.
        """
        for attempt in range(_TRIES):
            self.replies.clear()
            self.ask(opcode, data=data, is_repeated=attempt > 0)
            reply = self._session.wait_for(lambda: next((r for r in self.replies if r.request == opcode), None), _REPLY)
            if reply is not None:
                return reply
        raise NoReply(f"{self._session.vehicle} does not answer MAVLink FTP")


def read_remote_file(session: Session, path: str, timeout: float = 60.0) -> bytes:
    """Return the bytes of the file at *path* on the vehicle, e.g. ``@PARAM/param.pck``.

    Raises
    ------
    NoReply
        The vehicle does not answer, or the link is too slow. BadFile: there is no such file, or it cannot be read.
    """
    exchange = _Exchange(session)
    try:
        exchange.answer(_TERMINATE)  # one of ours left open; others' sessions are none of our business
        opened = exchange.answer(_OPEN, path.encode("ascii"))
        if not opened.is_ack:
            raise BadFile(f"{session.vehicle} has no readable file {path}{_why(opened)}")
        data = _read(session, exchange, Deadline.after(session.liveness, timeout), path)
        exchange.ask(_TERMINATE)
        return data
    finally:
        exchange.close()


def has_remote_folder(session: Session, path: str) -> bool:
    """Return whether the vehicle has the folder *path*.

    Raises
    ------
    NoReply
        The vehicle does not answer MAVLink FTP.
    """
    exchange = _Exchange(session)
    try:
        answer = exchange.answer(_LIST, path.encode("ascii"))
    finally:
        exchange.close()
    return answer.is_ack or answer.data[:1] == bytes([_END_OF_FILE])


def write_remote_file(session: Session, path: str, data: bytes, timeout: float = 120.0) -> None:
    """Write *data* to the file *path* on the vehicle, and verify its checksum. An existing file is replaced.

    Raises
    ------
    NoReply
        The vehicle does not answer, or the link is too slow. BadFile: the vehicle does not take the file.
    """
    exchange = _Exchange(session)
    try:
        exchange.answer(_TERMINATE)
        created = exchange.answer(_CREATE, path.encode("ascii"))
        if not created.is_ack:
            raise BadFile(f"{session.vehicle} cannot create the file {path}{_why(created)}")
        _write(session, exchange, Deadline.after(session.liveness, timeout), path, data)
        exchange.answer(_TERMINATE)
        reply = exchange.answer(_CHECKSUM, path.encode("ascii"))
        if not reply.is_ack or reply.data[:4] != struct.pack("<I", _checksum(data)):
            raise BadFile(f"{path} was not stored correctly on {session.vehicle}{_why(reply)}. Check its SD card")
    finally:
        exchange.close()


def _checksum(data: bytes) -> int:
    """Return the CRC32 of MAVLink FTP, which starts at 0 and is not inverted at the end."""
    return zlib.crc32(data, 0xFFFFFFFF) ^ 0xFFFFFFFF


def _write(session: Session, exchange: _Exchange, deadline: Deadline, path: str, data: bytes) -> None:
    missing = list(range(0, len(data), _PIECE))
    while missing:
        if deadline.expired:
            raise NoReply(f"{path} was not sent to {session.vehicle} completely in time. Try a faster link")
        sent = missing[:_ABREAST]
        exchange.replies.clear()
        for offset in sent:
            exchange.ask(_WRITE, offset=offset, data=data[offset : offset + _PIECE])
        session.wait_for(partial(exchange.has, len(sent)), _REPLY)
        for reply in exchange.replies:
            if reply.request == _WRITE and not reply.is_ack:
                raise BadFile(f"{session.vehicle} cannot write {path}{_why(reply)}")
            if reply.request == _WRITE and reply.offset in missing:
                missing.remove(reply.offset)


def remove_remote_file(session: Session, path: str) -> None:
    """Remove the file *path* from the vehicle. It is not an error if the file does not exist.

    Raises
    ------
    NoReply
        The vehicle does not answer. BadFile: the file cannot be removed.
    """
    exchange = _Exchange(session)
    try:
        exchange.answer(_TERMINATE)
        removed = exchange.answer(_REMOVE, path.encode("ascii"))
    finally:
        exchange.close()
    gone = removed.data[:1] == bytes([_NOT_FOUND]) or removed.data[:2] == bytes([_ERRNO, _ENOENT])
    if not removed.is_ack and not gone:
        raise BadFile(f"{path} cannot be removed from {session.vehicle}{_why(removed)}")


def _read(session: Session, exchange: _Exchange, deadline: Deadline, path: str) -> bytes:
    pieces: dict[int, bytes] = {}
    end: int | None = None
    while not deadline.expired:
        first = next(o for o in range(0, _LONGEST + _PIECE, _PIECE) if o not in pieces)
        if end is not None and first >= end:
            return b"".join(pieces[o] for o in sorted(pieces))[:end]
        if first > _LONGEST:
            raise BadFile(f"{path} of {session.vehicle} is longer than the limit of {_LONGEST} bytes")
        wanted = [o for o in range(first, first + _ABREAST * _PIECE, _PIECE) if o not in pieces]
        wanted = [o for o in wanted if end is None or o < end]
        exchange.replies.clear()
        for offset in wanted:
            exchange.ask(_READ, offset=offset, size=_PIECE)
        session.wait_for(partial(exchange.has, len(wanted)), _REPLY)
        for reply in exchange.replies:
            if reply.request != _READ:
                continue
            if not reply.is_ack and reply.data[:1] != bytes([_END_OF_FILE]):
                raise BadFile(f"{path} of {session.vehicle} cannot be read{_why(reply)}")
            length = len(reply.data) if reply.is_ack else 0
            if reply.is_ack:
                pieces[reply.offset] = reply.data
            if length < _PIECE:  # a short piece, or none, is the end of the file
                end = reply.offset + length if end is None else min(reply.offset + length, end)
    raise NoReply(f"{path} of {session.vehicle} was not received completely in time. Try a faster link")


def _why(reply: _Reply) -> str:
    return f": {_ERRORS.get(reply.data[0], f'error {reply.data[0]}')}" if reply.data else ""
