"""MAVLink signing as on an ArduPilot telemetry port. A port with a key accepts only messages signed with that key.

Its signing clock starts at the stored time, here zero as on an autopilot that never had GPS time. The clock is set
forward to the latest time received. RADIO_STATUS and RADIO need no signature. SETUP_SIGNING sets a key; all zeros
remove it. While armed, SETUP_SIGNING is rejected.
"""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Any

from sitl.autopilot import WARNING
from sitl.mavlink.dialect import Message, mavlink
from sitl.mavlink.port import Port

__all__ = ["demand_signatures", "handle_setup_signing", "read_key"]

_KEY_LENGTH = 32
_UNSIGNED = (mavlink.MAVLINK_MSG_ID_RADIO_STATUS, mavlink.MAVLINK_MSG_ID_RADIO)


def read_key(path: Path) -> bytes:
    """Return the key in a file of 32 bytes, or the SHA-256 of the one line of text in it.

    Raises
    ------
    ValueError
        The file cannot be read or is empty.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise ValueError(f"--signing-key {path}: {error.strerror}") from error
    if len(data) == _KEY_LENGTH and not (data.isascii() and data.decode().isprintable()):
        return data
    line = data.rstrip(b"\r\n")
    if not line:
        raise ValueError(f"--signing-key {path}is empty. It must be 32 bytes or a passphrase")
    return hashlib.sha256(line).digest()


def demand_signatures(codec: Any, key: bytes, timestamp: int = 0) -> None:
    """Sign the frames that *codec* packs and reject frames not signed with *key*. An empty key ends signing."""
    signing = codec.signing
    signing.secret_key = key or None
    signing.sign_outgoing = bool(key)
    signing.timestamp = timestamp
    signing.stream_timestamps.clear()
    signing.allow_unsigned_callback = lambda _, number: number in _UNSIGNED


def handle_setup_signing(port: Port, message: Message) -> None:
    """Set the key in the SETUP_SIGNING message, or remove the key if it is all zeros."""
    if port.vehicle.autopilot.armed:
        port.vehicle.autopilot.say(WARNING, "ERROR: Won't setup signing when armed")
        return
    key = bytes(message.secret_key)
    demand_signatures(port.codec, key if any(key) else b"", message.initial_timestamp)
