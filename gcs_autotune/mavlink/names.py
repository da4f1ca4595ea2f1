"""Names for MAVLink's numbers: messages, commands, vehicle types, versions. Also the vehicle's STATUSTEXT."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass
from functools import cache
from typing import Any

from gcs_autotune.mavlink.framing import Message, mavlink

__all__ = [
    "StatusText",
    "TextLog",
    "VehicleIdentity",
    "enum_name",
    "firmware_version",
    "message_fields",
    "message_number",
    "type_name",
    "unique_id",
]

_STAGES = {0: "dev", 64: "alpha", 128: "beta", 192: "rc", 255: "official"}
"""FIRMWARE_VERSION_TYPE -> suffix of the version."""


@dataclass(frozen=True, slots=True)
class VehicleIdentity:
    """The identity of an autopilot.

    ``autopilot`` and ``vehicle_type`` are HEARTBEAT's numbers; ``version`` comes from AUTOPILOT_VERSION. ``uid`` is the
    unique id of the autopilot's board (hexadecimal). Both are empty if not reported. ``frame`` is the firmware's frame
    parameter, None if there is none.
    """

    system: int
    component: int
    autopilot: int
    vehicle_type: int
    firmware: str = ""
    version: str = ""
    frame: int | None = None
    uid: str = ""

    def to_dict(self) -> dict[str, Any]:
        """Return the fields as plain data for JSON."""
        return asdict(self)

    def __str__(self) -> str:
        name = " ".join(part for part in (self.firmware or type_name(self.vehicle_type), self.version) if part)
        return f"{name} (system {self.system}, component {self.component})"


def firmware_version(message: Message) -> str:
    """Return AUTOPILOT_VERSION.flight_sw_version as text, e.g. ``4.7.0-dev``; ``""`` for zero."""
    word = int(message.flight_sw_version)
    if not word:
        return ""
    major, minor, patch, stage = (word >> shift & 0xFF for shift in (24, 16, 8, 0))
    suffix = "" if stage == 255 else f"-{_STAGES.get(stage, str(stage))}"
    return f"{major}.{minor}.{patch}{suffix}"


def unique_id(message: Message) -> str:
    """Return the board id in AUTOPILOT_VERSION in hexadecimal, the long one if reported; ``""`` without any."""
    long = bytes(message.uid2).rstrip(b"\0")
    if long:
        return long.hex()
    return f"{int(message.uid):x}" if message.uid else ""


def enum_name(table: str, number: int) -> str:
    """Return the name of entry *number* of the enumeration *table*, e.g. of ``MAV_CMD``.

    Without a name, return both as text.
    """
    entry = mavlink.enums[table].get(number)
    return str(entry.name) if entry else f"{table} {number}"


def type_name(vehicle_type: int) -> str:
    """Return the name of a MAV_TYPE, e.g. ``SURFACE_BOAT``."""
    return enum_name("MAV_TYPE", vehicle_type).removeprefix("MAV_TYPE_")


def message_number(name: str) -> int:
    """Return the id of the MAVLink message called *name*."""
    return int(getattr(mavlink, f"MAVLINK_MSG_ID_{name}"))


@cache
def message_fields(name: str) -> frozenset[str]:
    """Return the names of the fields of the message called *name*; empty if there is no such message."""
    kind = next((k for k in mavlink.mavlink_map.values() if getattr(k, "msgname", "") == name), None)
    return frozenset(kind.fieldnames) if kind is not None else frozenset()


_PIECE = 50
_KEPT = 500
_LONGEST = 1000
"""Number of characters kept of a text in several pieces, of which up to 255 may arrive."""


@dataclass(frozen=True, slots=True)
class StatusText:
    """One text message of the vehicle. ``severity``: 0 (emergency) to 7 (debug). ``t``: link-clock time [s]."""

    t: float
    severity: int
    text: str


class TextLog:
    """Collects text messages, newest last, at most 500."""

    def __init__(self) -> None:
        self._texts: list[StatusText] = []
        self._open: tuple[int, int, str] | None = None
        self.count = 0

    def take(self, message: Message, t: float) -> StatusText | None:
        """Process one STATUSTEXT. Return the text that it completes, if any."""
        piece = str(message.text)
        ident, sequence = int(getattr(message, "id", 0)), int(getattr(message, "chunk_seq", 0))
        if ident == 0:
            return self._add(StatusText(t, int(message.severity), piece))
        before = ""
        if self._open is not None and self._open[0] == ident and self._open[1] == sequence - 1:
            before = self._open[2]
        joined = before + piece
        if len(piece) == _PIECE:
            self._open = (ident, sequence, joined[:_LONGEST])
            return None
        self._open = None
        return self._add(StatusText(t, int(message.severity), joined))

    def _add(self, text: StatusText) -> StatusText:
        self.count += 1
        self._texts.append(text)
        del self._texts[:-_KEPT]
        return text

    def since(self, count: int) -> list[StatusText]:
        """Return the texts added since :attr:`count` had the given value."""
        new = self.count - count
        return self._texts[-new:] if new > 0 else []

    def recent(self, t: float, *, at_most: int = 3) -> list[str]:
        """Return the last few texts received since link time *t*."""
        return [text.text for text in self._texts if text.t >= t][-at_most:]

    def __iter__(self) -> Iterator[StatusText]:
        return iter(self._texts)
