"""Convert bytes to MAVLink messages and back. This is the only file that uses pymavlink's parser.

Frames are recognised by their start byte, length and checksum. Anything else is skipped and counted. So line noise,
partial frames and foreign protocols never cause an exception.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator
from functools import cache
from operator import attrgetter
from typing import Any, NamedTuple, TypeAlias

from pymavlink.dialects.v20 import ardupilotmega as mavlink

__all__ = [
    "AT_WORK",
    "Frame",
    "Framer",
    "Message",
    "Packer",
    "decode_frame",
    "mavlink",
    "message_request",
    "our_heartbeat",
    "split_frames",
]

Message: TypeAlias = Any
"""A pymavlink message object, with its fields as attributes. Names are those of the MAVLink XML."""

_V1, _V2 = 0xFE, 0xFD
_OVERHEAD = {_V1: 8, _V2: 12}
_SIGNATURE = 13
_SIGNED = 0x01
_LONGEST = 255 + 12 + _SIGNATURE
_HEADER = struct.Struct("<BBBBBBBHB")
_HEADER_LENGTH, _CHECKSUM = 10, 2


class Frame(NamedTuple):
    """One complete frame as received, decoded.

    ``name`` is e.g. ``ATTITUDE`` or ``UNKNOWN_12345``. ``origin`` is the address of
    the sender, on links with several senders.
    """

    raw: bytes
    message: Message
    name: str
    system: int
    component: int
    origin: str = ""


class Framer:
    """Cuts the byte stream from one *origin* into frames.

    Attributes
    ----------
    bad_bytes : number of bytes that belong to no frame.
    bad_data : number of stretches of such bytes (counted as BAD_DATA by other tools).
    """

    def __init__(self, origin: str = "") -> None:
        self._origin = origin
        self._buffer = bytearray()
        self._decoder = mavlink.MAVLink(None)
        self._in_bad_stretch = False
        self.bad_bytes = 0
        self.bad_data = 0

    @property
    def pending(self) -> int:
        """Bytes held back because the frame that they seem to start is not complete."""
        return len(self._buffer)

    def feed(self, data: bytes) -> list[Frame]:
        """Process bytes and return the frames that they complete."""
        self._buffer += data
        return list(self._cut(final=False))

    def flush(self) -> list[Frame]:
        """Discard an unfinished frame, and return complete frames that may follow its false start."""
        return list(self._cut(final=True))

    def _cut(self, *, final: bool) -> Iterator[Frame]:
        buffer = self._buffer
        position = 0
        while position < len(buffer):
            length = frame_length(buffer, position)
            if length is not None and position + length > len(buffer) and not final:
                break
            frame = decode_frame(self._decoder, buffer[position : position + length], self._origin) if length else None
            if length is None or frame is None:
                self._skip()
                position += 1
            else:
                self._in_bad_stretch = False
                position += length
                yield frame
        del buffer[:position]

    def _skip(self) -> None:
        self.bad_bytes += 1
        self.bad_data += not self._in_bad_stretch
        self._in_bad_stretch = True


def frame_length(buffer: bytes | bytearray, position: int) -> int | None:
    """Return the length of the frame that starts at *position*; None if no frame can start there.

    If the header is still incomplete, it is the largest possible length.
    """
    start = buffer[position]
    if start not in _OVERHEAD:
        return None
    if position + 2 >= len(buffer):
        return _LONGEST
    length = buffer[position + 1] + _OVERHEAD[start]
    if start == _V2:
        flags = buffer[position + 2]
        if flags & ~_SIGNED:
            return None
        length += _SIGNATURE if flags & _SIGNED else 0
    return length


class _Kind(NamedTuple):
    """Layout of a message without arrays: its fields in the order of transmission.

    ``order``: position in them of each argument of ``make``; None: the same order.
    """

    make: Callable[..., Message]
    layout: struct.Struct
    fields: Callable[[Message], tuple[Any, ...]]
    order: tuple[int, ...] | None
    seed: bytes


@cache
def _plain_kind(number: int) -> _Kind | None:
    """Return the layout of the message with that *number*; None for one with arrays or an unknown number."""
    made = mavlink.mavlink_map.get(number)
    if made is None or len(made.ordered_fieldnames) < 2 or any(made.array_lengths):
        return None
    order = tuple(made.orders)
    straight = order == tuple(range(len(order)))
    fields = attrgetter(*made.ordered_fieldnames)
    return _Kind(made, made.unpacker, fields, None if straight else order, bytes((made.crc_extra,)))


def _decode_plain(raw: bytearray) -> Message | None:
    """Decode an unsigned MAVLink 2 frame like pymavlink, in half its time. None: pymavlink must decode it."""
    if len(raw) <= _OVERHEAD[_V2] or raw[0] != _V2 or raw[2] or raw[1] != len(raw) - _OVERHEAD[_V2]:
        return None
    kind = _plain_kind(raw[7] | raw[8] << 8 | raw[9] << 16)
    checksum = raw[-2] | raw[-1] << 8
    if kind is None or mavlink.x25crc(raw[1:-_CHECKSUM] + kind.seed).crc != checksum:
        return None
    size = kind.layout.size
    values = kind.layout.unpack(raw[_HEADER_LENGTH:-_CHECKSUM].ljust(size, b"\0")[:size])
    message = kind.make(*(values if kind.order is None else [values[place] for place in kind.order]))
    header = message.get_header()
    header.mlen, header.compat_flags, header.seq = raw[1], raw[3], raw[4]
    header.srcSystem, header.srcComponent = raw[5], raw[6]
    message._msgbuf, message._payload, message._crc = raw, raw[6:-_CHECKSUM], checksum
    return message


def _pack_plain(message: Message, mav: Any) -> bytes | None:
    """Encode *message* as an unsigned MAVLink 2 frame like pymavlink, in half its time.

    None: pymavlink must encode it.
    """
    number = type(message).id  # some have a field of that name
    kind = _plain_kind(number)
    if kind is None:
        return None
    payload = kind.layout.pack(*kind.fields(message)).rstrip(b"\0") or b"\0"
    head = (_V2, len(payload), 0, 0, mav.seq, mav.srcSystem, mav.srcComponent, number & 0xFFFF, number >> 16)
    frame = _HEADER.pack(*head) + payload
    checksum: int = mavlink.x25crc(frame[1:] + kind.seed).crc
    return frame + checksum.to_bytes(_CHECKSUM, "little")


def decode_frame(decoder: Any, raw: bytearray, origin: str = "") -> Frame | None:
    """Return the decoded frame; None if its checksum or anything else is wrong.

    *decoder* does not check signatures.
    """
    message = _decode_plain(raw)
    if message is None:
        try:
            message = decoder.decode(raw)
        except mavlink.MAVError:
            return None
    at = 5 if raw[0] == _V2 else 3
    return Frame(bytes(raw), message, message.get_type(), raw[at], raw[at + 1], origin)


def split_frames(data: bytes) -> list[bytes]:
    """Split *data*, which consists of complete frames, into frames. A remainder, if any, comes last."""
    pieces: list[bytes] = []
    position = 0
    while position < len(data):
        length = frame_length(data, position) or len(data) - position
        pieces.append(data[position : position + length])
        position += length
    return pieces


class Packer:
    """Encodes messages as frames with our ids and a running sequence number."""

    def __init__(self, system: int, component: int) -> None:
        self._mav = mavlink.MAVLink(None, srcSystem=system, srcComponent=component)
        self._stamp: Callable[[], int] | None = None

    def sign_with(self, secret: bytes, link_id: int, stamp: Callable[[], int]) -> None:
        """Sign every frame from now on with the 32 bytes *secret*.

        *stamp* returns the signing time of the next frame.
        """
        signing = self._mav.signing
        signing.secret_key, signing.link_id, signing.sign_outgoing = secret, link_id, True
        self._stamp = stamp

    @property
    def system(self) -> int:
        """System id used for sending."""
        return int(self._mav.srcSystem)

    @system.setter
    def system(self, value: int) -> None:
        self._mav.srcSystem = value

    @property
    def component(self) -> int:
        """Component id used for sending."""
        return int(self._mav.srcComponent)

    def pack(self, message: Message, component: int | None = None) -> bytes:
        """Return *message* as a MAVLink 2 frame, optionally from another *component* id."""
        if component is not None:
            usual, self._mav.srcComponent = self._mav.srcComponent, component
            try:
                return self.pack(message)
            finally:
                self._mav.srcComponent = usual
        if self._stamp is None:
            frame = _pack_plain(message, self._mav) or bytes(message.pack(self._mav))
        else:
            self._mav.signing.timestamp = self._stamp()
            frame = bytes(message.pack(self._mav))
        self._mav.seq = (self._mav.seq + 1) % 256
        return frame


AT_WORK = 0x67637361
"""Value of ``custom_mode`` ("gcsa") in the HEARTBEAT of a station with a run in progress. Ground stations send 0."""


def our_heartbeat(*, at_work: bool = False) -> Message:
    """Return the HEARTBEAT of a ground station. *at_work*: a run is in progress, so no other should begin."""
    return mavlink.MAVLink_heartbeat_message(
        mavlink.MAV_TYPE_GCS,
        mavlink.MAV_AUTOPILOT_INVALID,
        0,
        AT_WORK if at_work else 0,
        mavlink.MAV_STATE_ACTIVE,
        3,
    )


def message_request(system: int, component: int, number: int) -> Message:
    """Return the MAV_CMD_REQUEST_MESSAGE that requests the message with that *number* once."""
    return mavlink.MAVLink_command_long_message(
        system, component, mavlink.MAV_CMD_REQUEST_MESSAGE, 0, *(float(number), 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    )
