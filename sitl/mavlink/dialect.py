"""The only import of pymavlink's generated code (untyped), and a fast path for simple frames."""

from __future__ import annotations

import struct
from collections.abc import Callable
from functools import cache
from operator import attrgetter
from typing import Any, NamedTuple

from pymavlink.dialects.v20 import ardupilotmega

__all__ = ["Message", "fit_float", "mavlink", "pack", "parse"]

mavlink: Any = ardupilotmega
"""Constants and message classes of the ardupilotmega dialect, MAVLink 2."""
Message = Any
"""A MAVLink message of pymavlink, decoded or to be sent."""
_LARGEST_FLOAT = 3.4028234e38


def fit_float(value: float) -> float:
    """Return *value* limited to the range of a float field in a message."""
    return max(-_LARGEST_FLOAT, min(_LARGEST_FLOAT, value))


_START, _HEADER_LENGTH, _CHECKSUM = 0xFD, 10, 2
_HEADER = struct.Struct("<BBBBBBBHB")


class _Kind(NamedTuple):
    """Layout of a message without arrays.

    ``order``: positions of the arguments of ``make`` among the fields; None: in the same order.
    """

    make: Callable[..., Message]
    layout: struct.Struct
    fields: Callable[[Message], tuple[Any, ...]]
    order: tuple[int, ...] | None
    seed: bytes


@cache
def _kind(number: int) -> _Kind | None:
    made = mavlink.mavlink_map.get(number)
    if made is None or len(made.ordered_fieldnames) < 2 or any(made.array_lengths):
        return None
    order = tuple(made.orders)
    straight = order == tuple(range(len(order)))
    fields = attrgetter(*made.ordered_fieldnames)
    return _Kind(made, made.unpacker, fields, None if straight else order, bytes((made.crc_extra,)))


def pack(message: Message, codec: Any) -> bytes:
    """Return the frame of *message*, as ``message.pack(codec)`` does, but faster for messages without arrays."""
    number = type(message).id  # some have a field of that name
    kind = _kind(number)
    if kind is None or codec.signing.sign_outgoing:
        return bytes(message.pack(codec))
    payload = kind.layout.pack(*kind.fields(message)).rstrip(b"\0") or b"\0"
    head = (_START, len(payload), 0, 0, codec.seq, codec.srcSystem, codec.srcComponent, number & 0xFFFF, number >> 16)
    frame = _HEADER.pack(*head) + payload
    checksum: int = mavlink.x25crc(frame[1:] + kind.seed).crc
    return frame + checksum.to_bytes(_CHECKSUM, "little")


def parse(codec: Any, data: bytes) -> list[Message]:
    """Return the messages in *data*, as ``codec.parse_buffer`` does, but faster for complete, valid frames."""
    messages: list[Message] = []
    position = 0
    if not codec.buf_len() and codec.signing.secret_key is None:
        while (end := _end_of_frame(data, position)) is not None:
            message = _decode(data[position:end])
            if message is None:
                break
            messages.append(message)
            position = end
    if position < len(data):
        messages += codec.parse_buffer(data[position:]) or ()
    return messages


def _end_of_frame(data: bytes, position: int) -> int | None:
    """Return the end of the unsigned frame that starts at *position*; None if there is no complete one."""
    if position + _HEADER_LENGTH >= len(data) or data[position] != _START or data[position + 2]:
        return None
    end = position + _HEADER_LENGTH + data[position + 1] + _CHECKSUM
    return end if end <= len(data) else None


def _decode(raw: bytes) -> Message | None:
    """Return the message in a frame by the fast path; None if pymavlink must decode it."""
    kind = _kind(raw[7] | raw[8] << 8 | raw[9] << 16)
    checksum = raw[-2] | raw[-1] << 8
    if kind is None or mavlink.x25crc(raw[1:-_CHECKSUM] + kind.seed).crc != checksum:
        return None
    size = kind.layout.size
    values = kind.layout.unpack(raw[_HEADER_LENGTH:-_CHECKSUM].ljust(size, b"\0")[:size])
    message = kind.make(*(values if kind.order is None else [values[place] for place in kind.order]))
    header = message.get_header()
    header.mlen, header.compat_flags, header.seq = raw[1], raw[3], raw[4]
    header.srcSystem, header.srcComponent = raw[5], raw[6]
    return message
