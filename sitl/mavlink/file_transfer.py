"""MAVLink FTP, as far as ground stations need it to read parameters: ``@PARAM/param.pck``, optionally with defaults."""

from __future__ import annotations

import struct

from sitl.mavlink.dialect import Message, mavlink
from sitl.mavlink.port import Port

__all__ = ["FileTransfer", "packed"]

_HEAD = struct.Struct("<HBBBBBBI")
_TERMINATE, _RESET, _OPEN, _READ, _BURST = 1, 2, 4, 5, 15
_ACK, _NACK = 128, 129
_END_OF_FILE, _UNKNOWN, _NOT_FOUND = 6, 7, 10
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
        own = default is not None and default != store[name]
        if own:
            value += struct.pack(code, default if code == "<f" else int(default or 0))
        entry = bytes([kind | (0x10 if own else 0), shared | (len(rest) - 1) << 4]) + rest + value
        room = _PIECE - len(out) % _PIECE
        if len(entry) > room:
            out += bytes(room)
        out += entry
        before = name
    return bytes(out)


class FileTransfer:
    """Answers open, read, burst and close requests, for one file at a time, for reading only."""

    def __init__(self, port: Port) -> None:
        self._port = port
        self._file: bytes | None = None

    def handle(self, message: Message) -> None:
        """Execute one FILE_TRANSFER_PROTOCOL request and send the answer."""
        raw = bytes(message.payload)
        sequence, session, opcode, size, _, _, _, offset = _HEAD.unpack_from(raw)
        data = raw[_HEAD.size : _HEAD.size + size]
        sender = message.get_srcSystem(), message.get_srcComponent()

        def reply(answer: int, payload: bytes, at: int = offset, last: int = 0, k: int = 1) -> None:
            head = _HEAD.pack((sequence + k) & 0xFFFF, session, answer, len(payload), opcode, last, 0, at)
            whole = (head + payload).ljust(_PAYLOAD, b"\0")
            self._port.send(mavlink.MAVLink_file_transfer_protocol_message(0, *sender, whole))

        if opcode in (_RESET, _TERMINATE):
            self._file = None
            reply(_ACK, b"")
        elif opcode == _OPEN:
            path, _, query = data.rstrip(b"\0").decode("ascii", "replace").partition("?")
            if path != "@PARAM/param.pck":
                reply(_NACK, bytes([_NOT_FOUND]))
                return
            self._file = packed(self._port, defaults="withdefaults=1" in query.split("&"))
            reply(_ACK, struct.pack("<I", len(self._file)))
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
