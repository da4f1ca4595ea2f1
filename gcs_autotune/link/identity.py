"""Who is at the other end."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

from gcs_autotune.link.wire import Message, mavlink

__all__ = ["VehicleIdentity", "firmware_version", "type_name", "unique_id"]

_STAGES = {0: "dev", 64: "alpha", 128: "beta", 192: "rc", 255: "official"}
"""FIRMWARE_VERSION_TYPE -> word."""


@dataclass(frozen=True, slots=True)
class VehicleIdentity:
    """An autopilot as it introduced itself.

    ``autopilot`` and ``vehicle_type`` are HEARTBEAT's numbers; ``version`` comes from AUTOPILOT_VERSION and
    is empty when it was not told, as is ``uid``, the unique id of the autopilot's board (hexadecimal); ``frame`` is
    the firmware's frame parameter, None when there is none.
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
    """Return AUTOPILOT_VERSION's id of the board in hexadecimal, the long one if it is told; ``""`` when neither is."""
    long = bytes(message.uid2).rstrip(b"\0")
    if long:
        return long.hex()
    return f"{int(message.uid):x}" if message.uid else ""


def type_name(vehicle_type: int) -> str:
    """Return MAV_TYPE in words, e.g. ``SURFACE_BOAT``."""
    entry = mavlink.enums["MAV_TYPE"].get(vehicle_type)
    return entry.name.removeprefix("MAV_TYPE_") if entry else f"MAV_TYPE {vehicle_type}"
