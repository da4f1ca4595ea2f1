"""Operator control (MAVLink's development set): which station a vehicle obeys, as it says itself.

CONTROL_STATUS is in no dialect of pymavlink yet, so it is read here from the frame. It has been on the wire in two
forms; the checksum, which covers the fields' names, tells them apart.
"""

from __future__ import annotations

from dataclasses import dataclass

from gcs_autotune.mavlink.framing import Message, mavlink

__all__ = ["CONTROL_STATUS_NAMES", "REQUEST_OPERATOR_CONTROL", "ControlStatus", "control_status"]

CONTROL_STATUS_NAMES = ("CONTROL_STATUS", "UNKNOWN_512")
"""What frames of it are called, by a pymavlink that knows it and by one that does not."""
REQUEST_OPERATOR_CONTROL = 32100
"""MAV_CMD_REQUEST_OPERATOR_CONTROL; the vehicle passes one of another station on to the one in control."""
_HEADER, _CHECKSUM = 10, 2
_TAKEOVER_ALLOWED = 2
_FORMS = {21: (1, 0), 184: (0, 1)}
"""CRC_EXTRA of the form -> places of gcs_main (once sysid_in_control) and of flags in its payload."""


@dataclass(frozen=True, slots=True)
class ControlStatus:
    """Who is in control: ``station`` its system id, 0: nobody; ``takeover_allowed``: another one gets it for asking."""

    station: int
    takeover_allowed: bool


def control_status(message: Message) -> ControlStatus | None:
    """Return what a CONTROL_STATUS says; None when it is damaged, or of a form that is not known."""
    raw = bytes(message.get_msgbuf() or b"")
    if len(raw) < _HEADER + _CHECKSUM or raw[0] != 0xFD:
        return None
    end = _HEADER + raw[1]
    told = int.from_bytes(raw[end : end + _CHECKSUM], "little")
    payload = raw[_HEADER:end].ljust(2, b"\0")  # zeros at its end are not sent
    for extra, (station, flags) in _FORMS.items():
        if mavlink.x25crc(raw[1:end] + bytes([extra])).crc == told:
            return ControlStatus(payload[station], bool(payload[flags] & _TAKEOVER_ALLOWED))
    return None
