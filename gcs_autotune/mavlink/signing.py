"""MAVLink 2 signing: sign our messages, verify those received.

A signed frame ends with 13 bytes: link id, a 48-bit time [10 us since 2015-01-01 UTC], and the first 6 bytes of the
SHA-256 of key and frame. A receiver rejects frames that are unsigned, wrongly signed, or not newer than the last one
of the same stream (system, component, link id); a new stream may be at most a minute behind. Source: MAVLink developer
guide, "Message Signing". A passphrase becomes the key by SHA-256, as in Mission Planner and MAVProxy.

The latest signing time is stored on disk, since a vehicle rejects older ones even if our clock was set back.
"""

from __future__ import annotations

import hashlib
import hmac
import os
import sys
from collections import Counter
from collections.abc import Callable
from enum import StrEnum
from pathlib import Path
from typing import Self

from gcs_autotune.errors import BadFile, UsageError
from gcs_autotune.mavlink.framing import Frame

__all__ = [
    "EPOCH",
    "LINK_ID",
    "UNITS_PER_SECOND",
    "Refusal",
    "Signer",
    "SigningKey",
    "StampStore",
    "is_signed",
    "refusals",
    "state_folder",
]

EPOCH = 1_420_070_400.0
"""Start of signing time: 2015-01-01 00:00 UTC [s since 1970]."""
UNITS_PER_SECOND = 100_000
LINK_ID = 103
"""Link id of our signed frames, different from that of other ground stations with the same system id. Project
choice."""

_KEY_LENGTH = 32
_TRAILER, _SIGNATURE = 13, 6
_BEHIND = 60 * UNITS_PER_SECOND
_V2, _SIGNED = 0xFD, 0x01
_UNSIGNED_IS_FINE = ("RADIO_STATUS", "RADIO")
"""Messages of a telemetry radio itself. It has no key, and ArduPilot exempts the same two messages."""


class SigningKey:
    """The 32 secret bytes. They are never shown as text or stored on disk."""

    __slots__ = ("_origin", "_secret")

    def __init__(self, secret: bytes, origin: str = "") -> None:
        if len(secret) != _KEY_LENGTH:
            raise UsageError(f"the signing key has {len(secret)} bytes. It must have {_KEY_LENGTH}")
        self._secret = bytes(secret)
        self._origin = origin

    @classmethod
    def from_passphrase(cls, passphrase: str, origin: str = "passphrase") -> Self:
        """Return the key made by SHA-256 from *passphrase*, as in Mission Planner and MAVProxy.

        Raises
        ------
        UsageError
            It is empty.
        """
        if not passphrase:
            raise UsageError(f"the signing passphrase ({origin}) is empty")
        return cls(hashlib.sha256(passphrase.encode()).digest(), origin)

    @classmethod
    def read(cls, path: Path) -> Self:
        """Read a file of exactly 32 bytes (the key) or of one line of text (the passphrase).

        A file of 32 printable bytes counts as a passphrase. A random key is printable only once in 10^13 times.

        Raises
        ------
        BadFile
            It cannot be read, or has another content.
        """
        try:
            data = path.read_bytes()
        except OSError as error:
            raise BadFile(f"the signing key {path} cannot be read: {error.strerror}") from error
        if len(data) == _KEY_LENGTH and not (data.isascii() and data.decode().isprintable()):
            return cls(data, f"key in {path}")
        try:
            lines = data.decode().splitlines()
        except UnicodeDecodeError:
            lines = []
        if len(lines) != 1 or not lines[0]:
            raise BadFile(
                f"{path} contains no signing key. It must contain {_KEY_LENGTH} bytes (the key) or one line of text "
                f"(the passphrase), but contains {len(data)} bytes"
            )
        return cls.from_passphrase(lines[0], f"passphrase in {path}")

    @property
    def secret(self) -> bytes:
        """The key as 32 bytes."""
        return self._secret

    @property
    def origin(self) -> str:
        """Where the key came from, as text for the operator."""
        return self._origin

    def __repr__(self) -> str:
        return f"<signing key, {self._origin or 'given'}>"

    def __reduce__(self) -> str | tuple[object, ...]:
        raise TypeError("a signing key must not be stored")


class Refusal(StrEnum):
    """Reason why a frame was rejected."""

    UNSIGNED = "not signed"
    WRONG = "signed with another key"
    OLD = "signed too long ago"


class Signer:
    """Signing time of messages sent, and verification of messages received.

    Parameters
    ----------
    key : the secret shared with the vehicle.
    now : the time [s since 1970].
    store : keeps the time increasing from run to run; None for simulated links.

    Attributes
    ----------
    refused : reason -> number of rejected frames.
    """

    def __init__(self, key: SigningKey, now: Callable[[], float], store: StampStore | None = None) -> None:
        self.key = key
        self.refused: Counter[Refusal] = Counter()
        self._now = now
        self._store = store
        self._last = store.last if store else 0
        self._streams: dict[tuple[int, int, int], int] = {}

    def next_stamp(self) -> int:
        """Return the signing time [10 us since 2015] of the next frame.

        It is later than all previous ones, also of earlier runs.
        """
        self._last = max(round((self._now() - EPOCH) * UNITS_PER_SECOND), self._last + 1)
        if self._store:
            self._store.reach(self._last)
        return self._last

    def believes(self, frame: Frame) -> bool:
        """Return whether a received frame is accepted. Rejected frames are counted."""
        refusal = self._judge(frame)
        if refusal is not None:
            self.refused[refusal] += 1
        return refusal is None

    def _judge(self, frame: Frame) -> Refusal | None:
        raw = frame.raw
        if raw[0] != _V2 or not raw[2] & _SIGNED:
            return None if frame.name in _UNSIGNED_IS_FINE else Refusal.UNSIGNED
        signature = hashlib.sha256(self.key.secret + raw[:-_SIGNATURE]).digest()[:_SIGNATURE]
        if not hmac.compare_digest(signature, raw[-_SIGNATURE:]):
            return Refusal.WRONG
        stream = (frame.system, frame.component, raw[-_TRAILER])
        stamp = int.from_bytes(raw[1 - _TRAILER : -_SIGNATURE], "little")
        known = self._streams.get(stream)
        if known is None:
            is_old = stamp + _BEHIND < max(self._last, round((self._now() - EPOCH) * UNITS_PER_SECOND))
        else:
            is_old = stamp <= known
        if is_old:
            return Refusal.OLD
        self._streams[stream] = stamp
        self._last = max(self._last, stamp)
        return None


def refusals(signer: Signer | None) -> str:
    """Return the number of rejected messages and the reason, for errors about silence; empty if there are none."""
    if signer is None or not signer.refused:
        return ""
    return "refused: " + ", ".join(f"{count} messages {why}" for why, count in signer.refused.most_common())


def is_signed(frame: Frame) -> bool:
    """Return whether *frame* is signed, correctly or not."""
    return frame.raw[0] == _V2 and bool(frame.raw[2] & _SIGNED)


_AHEAD = 30 * 100_000
"""Signing time reserved in the file at once: 30 s [10 us].

A run that is killed has never used a later time than the file contains. Project choice.
"""
_FILE = "signing-time"


def state_folder() -> Path:
    """Return the folder in which this program stores data between runs."""
    if sys.platform == "win32":
        base = Path(os.environ.get("LOCALAPPDATA") or Path.home())
    else:
        base = Path(os.environ.get("XDG_STATE_HOME") or Path.home() / ".local" / "state")
    return base / "gcs-autotune"


class StampStore:
    """A number in a file that only increases. It contains no part of a key.

    Attributes
    ----------
    trouble : why it cannot be stored; empty if it can. Signing then depends on the computer's clock alone.
    """

    def __init__(self, folder: Path | None = None) -> None:
        self._path = (folder or state_folder()) / _FILE
        self.trouble = ""
        self.last = self._read()
        self._reserved = self.last

    def reach(self, stamp: int) -> None:
        """Make sure that the file contains at least *stamp* [10 us since 2015]."""
        if stamp < self._reserved:
            return
        self._reserved = max(stamp, self._read()) + _AHEAD
        try:
            self._path.parent.mkdir(parents=True, exist_ok=True)
            draft = self._path.with_suffix(f".{os.getpid()}")
            draft.write_text(f"{self._reserved}\n")
            draft.replace(self._path)
        except OSError as error:
            self._note(error)

    def _read(self) -> int:
        try:
            return int(self._path.read_text())
        except FileNotFoundError:
            return 0
        except (OSError, ValueError) as error:
            self._note(error)
            return 0

    def _note(self, error: Exception) -> None:
        self.trouble = self.trouble or (
            f"the signing time of earlier runs ({self._path}) cannot be stored: {error}. If this computer's clock is "
            "set back, the vehicle ignores this tool's messages"
        )
