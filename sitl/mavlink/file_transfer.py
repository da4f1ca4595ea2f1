"""MAVLink FTP: read parameters (``@PARAM/param.pck``, optionally with defaults), and write, read and remove files on
the SD card.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable

from sitl.mavlink.dialect import Message, mavlink
from sitl.mavlink.port import Port

__all__ = ["FileTransfer", "packed"]

_HEAD = struct.Struct("<HBBBBBBI")
_TERMINATE, _RESET, _LIST, _OPEN, _READ, _CREATE, _WRITE, _REMOVE, _CHECKSUM, _BURST = 1, 2, 3, 4, 5, 6, 7, 8, 14, 15
_ACK, _NACK = 128, 129
_FAIL, _ERRNO, _END_OF_FILE, _UNKNOWN, _NOT_FOUND = 1, 2, 6, 7, 10
_ENOENT = 2
_PIECE, _PAYLOAD = 239, 251
_CODES = {2: (1, "<b"), 4: (2, "<h"), 6: (3, "<i"), 9: (4, "<f")}
"""MAV_PARAM_TYPE -> type number in AP_Param, and packing of its value."""


def packed(port: Port, *, defaults: bool) -> bytes:
    """Return all parameters as the bytes of ArduPilot's ``param.pck``. No value crosses a boundary between two blocks
    of 239 bytes.
    """
    store = port.vehicle.dialect
    names = [name for i in range(len(store)) if (name := store.name_at(i)) is not None]
    out = bytearray(struct.pack("<HHH", 0x671C if defaults else 0x671B, len(names), len(names)))
    before = ""
    for name in names:
        kind, code = _CODES[store.kind_of(name)]
        default = store.default_of(name) if defaults else None
        shared = next((i for i, (a, b) in enumerate(zip(name, before, strict=False)) if a != b), len(before))
        shared = min(shared, 15, len(name) - 1)
        rest = name[shared:].encode("ascii")
        value = struct.pack(code, store[name] if code == "<f" else int(store[name]))
        is_changed = default is not None and default != store[name]
        if is_changed:
            value += struct.pack(code, default if code == "<f" else int(default or 0))
        entry = bytes([kind | (0x10 if is_changed else 0), shared | (len(rest) - 1) << 4]) + rest + value
        room = _PIECE - len(out) % _PIECE
        if len(entry) > room:
            out += bytes(room)
        out += entry
        before = name
    return bytes(out)


class FileTransfer:
    """Answers requests of one session, with one file open at a time."""

    def __init__(self, port: Port) -> None:
        self._port = port
        self._file: bytes | None = None
        self._written = ""
        self._last: tuple[int, bytes] = (-1, b"")

    def handle(self, message: Message) -> None:
        """Execute one FILE_TRANSFER_PROTOCOL request and send the answer. A repeated request is only answered again."""
        raw = bytes(message.payload)
        sequence, session, opcode, size, _, _, _, offset = _HEAD.unpack_from(raw)
        data = raw[_HEAD.size : _HEAD.size + size]
        sender = message.get_srcSystem(), message.get_srcComponent()

        def send(whole: bytes) -> None:
            self._port.send(mavlink.MAVLink_file_transfer_protocol_message(0, *sender, whole))

        def reply(answer: int, payload: bytes, at: int = offset, last: int = 0, k: int = 1) -> None:
            head = _HEAD.pack((sequence + k) & 0xFFFF, session, answer, len(payload), opcode, last, 0, at)
            self._last = sequence, (head + payload).ljust(_PAYLOAD, b"\0")
            send(self._last[1])

        if self._last[0] == sequence and opcode != _BURST:
            send(self._last[1])
        elif opcode in (_RESET, _TERMINATE):
            self._file, self._written = None, ""
            reply(_ACK, b"")
        elif opcode in (_LIST, _OPEN, _CREATE, _REMOVE, _CHECKSUM):
            self._on_path(opcode, data.rstrip(b"\0").decode("ascii", "replace"), reply)
        elif opcode == _WRITE:
            self._write(offset, data, reply)
        elif opcode not in (_READ, _BURST):
            reply(_NACK, bytes([_UNKNOWN]))
        elif self._file is None or offset >= len(self._file):
            reply(_NACK, bytes([_END_OF_FILE]))
        elif opcode == _READ:
            reply(_ACK, self._file[offset : offset + min(size, _PIECE)])
        else:
            step = size or _PIECE
            places = range(offset, len(self._file), step)
            for k, at in enumerate(places, start=1):
                reply(_ACK, self._file[at : at + step], at, int(at == places[-1]), k)

    def _on_path(self, opcode: int, path: str, reply: Callable[[int, bytes], None]) -> None:
        name, _, query = path.partition("?")
        card = self._port.vehicle.card
        path = path.strip("/")
        if opcode == _LIST:
            there = path in self._port.vehicle.folders
            reply(_NACK, bytes([_END_OF_FILE]) if there else bytes([_ERRNO, _ENOENT]))
        elif opcode == _OPEN and name == "@PARAM/param.pck":
            self._file = packed(self._port, defaults="withdefaults=1" in query.split("&"))
            reply(_ACK, struct.pack("<I", len(self._file)))
        elif opcode == _CREATE:
            if self._file is not None or self._written:
                reply(_NACK, bytes([_FAIL]))
            elif path.rpartition("/")[0] not in self._port.vehicle.folders:
                reply(_NACK, bytes([_ERRNO, _ENOENT]))
            else:
                card[path], self._written = b"", path
                reply(_ACK, b"")
        elif path not in card:
            reply(_NACK, bytes([_NOT_FOUND]) if opcode == _OPEN else bytes([_ERRNO, _ENOENT]))
        elif opcode == _OPEN:
            self._file = card[path]
            reply(_ACK, struct.pack("<I", len(self._file)))
        elif opcode == _REMOVE:
            del card[path]
            reply(_ACK, b"")
        else:
            reply(_ACK, struct.pack("<I", zlib.crc32(card[path], 0xFFFFFFFF) ^ 0xFFFFFFFF))

    def _write(self, offset: int, data: bytes, reply: Callable[[int, bytes], None]) -> None:
        if not self._written:
            reply(_NACK, bytes([_NOT_FOUND]))
            return
        before = self._port.vehicle.card[self._written].ljust(offset, b"\0")
        self._port.vehicle.card[self._written] = before[:offset] + data + before[offset + len(data) :]
        reply(_ACK, b"")
