"""MAVLink frames: bytes in, messages out, and back. The only file that touches pymavlink's parser.

Frames are found by their start byte, their length and their checksum; anything else is stepped over and
counted, so line noise, half frames and foreign protocols cost bytes and never an exception.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, TypeAlias

from pymavlink.dialects.v20 import ardupilotmega as mavlink

__all__ = [
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
"""A pymavlink message object: fields as attributes, names verbatim from the MAVLink XML."""

_V1, _V2 = 0xFE, 0xFD
_OVERHEAD = {_V1: 8, _V2: 12}
_SIGNATURE = 13
_SIGNED = 0x01
_LONGEST = 255 + 12 + _SIGNATURE


@dataclass(frozen=True, slots=True)
class Frame:
    """One whole frame as it was on the wire, decoded. ``name`` is e.g. ``ATTITUDE`` or ``UNKNOWN_12345``; ``origin``
    says where it came from, on links that can tell senders apart."""

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
    bad_bytes : bytes that belonged to no frame.
    bad_data : stretches of such bytes (what other tools count as BAD_DATA).
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
        """Bytes held back because the frame they seem to start is not complete."""
        return len(self._buffer)

    def feed(self, data: bytes) -> list[Frame]:
        """Take in bytes and return the frames they complete."""
        self._buffer += data
        return list(self._cut(final=False))

    def flush(self) -> list[Frame]:
        """Give up on an unfinished frame: return what may hide behind its false start."""
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
    """Return the length of the frame that starts at *position*, or None when none can start there.

    While the header is still incomplete the answer is the longest it can be.
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


def decode_frame(decoder: Any, raw: bytearray, origin: str = "") -> Frame | None:
    """Return the decoded frame, or None when its checksum (or anything else) is wrong."""
    try:
        message = decoder.decode(raw)
    except mavlink.MAVError:
        return None
    at = 5 if raw[0] == _V2 else 3
    return Frame(bytes(raw), message, message.get_type(), raw[at], raw[at + 1], origin)


def split_frames(data: bytes) -> list[bytes]:
    """Cut *data*, known to be whole frames, into frames (the remainder, if any, comes last)."""
    pieces: list[bytes] = []
    position = 0
    while position < len(data):
        length = frame_length(data, position) or len(data) - position
        pieces.append(data[position : position + length])
        position += length
    return pieces


class Packer:
    """Turns messages into frames with our ids and a running sequence number."""

    def __init__(self, system: int, component: int) -> None:
        self._mav = mavlink.MAVLink(None, srcSystem=system, srcComponent=component)
        self._stamp: Callable[[], int] | None = None

    def sign_with(self, secret: bytes, link_id: int, stamp: Callable[[], int]) -> None:
        """From now on sign every frame with the 32 bytes *secret*; *stamp* tells the signing time of the next one."""
        signing = self._mav.signing
        signing.secret_key, signing.link_id, signing.sign_outgoing = secret, link_id, True
        self._stamp = stamp

    @property
    def system(self) -> int:
        """The system id we send as."""
        return int(self._mav.srcSystem)

    @system.setter
    def system(self, value: int) -> None:
        self._mav.srcSystem = value

    @property
    def component(self) -> int:
        """The component id we send as."""
        return int(self._mav.srcComponent)

    def pack(self, message: Message) -> bytes:
        """Return *message* as a MAVLink 2 frame."""
        if self._stamp is not None:
            self._mav.signing.timestamp = self._stamp()
        frame = bytes(message.pack(self._mav))
        self._mav.seq = (self._mav.seq + 1) % 256
        return frame


def our_heartbeat() -> Message:
    """Return the HEARTBEAT of a ground station."""
    return mavlink.MAVLink_heartbeat_message(
        mavlink.MAV_TYPE_GCS, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, mavlink.MAV_STATE_ACTIVE, 3
    )


def message_request(system: int, component: int, number: int) -> Message:
    """Return the MAV_CMD_REQUEST_MESSAGE that has the message of that *number* sent once."""
    return mavlink.MAVLink_command_long_message(
        system, component, mavlink.MAV_CMD_REQUEST_MESSAGE, 0, *(float(number), 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    )
