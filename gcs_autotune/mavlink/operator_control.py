"""Operator control (MAVLink's development set): the station a vehicle obeys, and its source of steering.

CONTROL_STATUS and MANUAL_INPUT_STATUS are in no dialect of pymavlink yet, so they are decoded here from the frame. The
first exists in two forms. Their checksums differ, because these include the field names. The second was proposed as
MANUAL_CONTROL_STATUS.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

from gcs_autotune.mavlink.framing import Message, mavlink

__all__ = [
    "CONTROL_STATUS_NAMES",
    "MANUAL_INPUT_NAMES",
    "REQUEST_OPERATOR_CONTROL",
    "ControlStatus",
    "ManualInput",
    "control_status",
    "manual_input",
]

CONTROL_STATUS_NAMES = ("CONTROL_STATUS", "UNKNOWN_512")
"""Names of a CONTROL_STATUS frame: in a pymavlink that supports this message, and in one that does not."""
MANUAL_INPUT_NAMES = ("MANUAL_INPUT_STATUS", "UNKNOWN_515")
REQUEST_OPERATOR_CONTROL = 32100
"""Value of MAV_CMD_REQUEST_OPERATOR_CONTROL.

The vehicle forwards a request of another station to the one in control.
"""
_HEADER, _CHECKSUM = 10, 2
_TAKEOVER_ALLOWED = 2
_FORMS = {21: (1, 0), 184: (0, 1)}
"""CRC_EXTRA of the form -> positions in its payload of gcs_main (formerly sysid_in_control) and of the flags."""
_MANUAL_INPUT_EXTRA = 128
_RC = 1


@dataclass(frozen=True, slots=True)
class ControlStatus:
    """The station in control.

    ``station``: its system id; 0: none. ``takeover_allowed``: whether another station may take over.
    """

    station: int
    takeover_allowed: bool


@dataclass(frozen=True, slots=True)
class ManualInput:
    """The source of manual input.

    ``station``: (system, component) of a MAVLink input device; (0, 0): none. ``is_receiver``: only the vehicle's own RC
    receiver.
    """

    station: tuple[int, int]
    is_receiver: bool


def control_status(message: Message) -> ControlStatus | None:
    """Return the contents of a CONTROL_STATUS; None if the frame is damaged or of unknown form."""
    found = _checked(message, _FORMS)
    if found is None:
        return None
    extra, payload = found
    station, flags = _FORMS[extra]
    return ControlStatus(payload[station], bool(payload[flags] & _TAKEOVER_ALLOWED))


def manual_input(message: Message) -> ManualInput | None:
    """Return the contents of a MANUAL_INPUT_STATUS; None if the frame is damaged or of unknown form."""
    found = _checked(message, (_MANUAL_INPUT_EXTRA,))
    if found is None:
        return None
    source, system, component = found[1][:3]
    return ManualInput((system, component), source == _RC)


def _checked(message: Message, extras: Collection[int]) -> tuple[int, bytes] | None:
    """Return the matching CRC_EXTRA out of *extras* and the payload of the frame; None if none matches."""
    raw = bytes(message.get_msgbuf() or b"")
    if len(raw) < _HEADER + _CHECKSUM or raw[0] != 0xFD:
        return None
    end = _HEADER + raw[1]
    checksum = int.from_bytes(raw[end : end + _CHECKSUM], "little")
    payload = raw[_HEADER:end].ljust(3, b"\0")  # zeros at its end are not sent
    for extra in extras:
        if mavlink.x25crc(raw[1:end] + bytes([extra])).crc == checksum:
            return extra, payload
    return None
