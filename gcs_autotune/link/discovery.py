"""Distinguish the autopilot from other senders on a link, and read its identity."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Self

from gcs_autotune.errors import NoVehicle, SigningMismatch, UsageError
from gcs_autotune.firmware import firmware_for
from gcs_autotune.link.transports import not_mavlink_advice
from gcs_autotune.mavlink import (
    Frame,
    Message,
    Refusal,
    Signer,
    VehicleIdentity,
    is_signed,
    mavlink,
    refusals,
    type_name,
)

__all__ = [
    "Sightings",
    "VehicleCandidate",
    "cannot_be_commanded",
    "choose",
    "is_autopilot",
    "no_vehicle_error",
    "not_believed",
]


def is_autopilot(heartbeat: Message) -> bool:
    """Return whether a HEARTBEAT comes from an autopilot (a ground station or camera reports INVALID)."""
    return bool(heartbeat.autopilot != mavlink.MAV_AUTOPILOT_INVALID)


@dataclass(frozen=True, slots=True)
class VehicleCandidate:
    """An autopilot whose HEARTBEAT was received on the link: its ids, types and address."""

    system: int
    component: int
    autopilot: int
    vehicle_type: int
    armed: bool
    custom_mode: int
    origin: str = ""

    @classmethod
    def of(cls, frame: Frame) -> Self:
        """Return the sender of *frame*, a HEARTBEAT, as a candidate."""
        m = frame.message
        armed = bool(m.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)
        return cls(
            frame.system, frame.component, int(m.autopilot), int(m.type), armed, int(m.custom_mode), frame.origin
        )

    def identity(self, *, version: str = "", uid: str = "") -> VehicleIdentity:
        """Return the identity of this autopilot, with *version* and board *uid*."""
        return VehicleIdentity(
            self.system, self.component, self.autopilot, self.vehicle_type, self._firmware, version, uid=uid
        )

    @property
    def _firmware(self) -> str:
        """Name of the firmware, as in all later texts; empty if it is not supported."""
        firmware = firmware_for(self.autopilot, self.vehicle_type)
        return "" if firmware is None else firmware.name

    def __str__(self) -> str:
        return f"system {self.system} ({self._firmware or type_name(self.vehicle_type)})"


class Sightings:
    """Autopilots received on the link before one is chosen. ``candidates``: (system, component) -> autopilot."""

    def __init__(self) -> None:
        self.candidates: dict[tuple[int, int], VehicleCandidate] = {}
        self._signing: set[tuple[int, int]] = set()

    def take(self, frame: Frame) -> bool:
        """Record the sender if *frame* is an autopilot's HEARTBEAT. Return whether it is one."""
        if not (frame.name == "HEARTBEAT" and is_autopilot(frame.message)):
            return False
        if is_signed(frame):
            self._signing.add((frame.system, frame.component))
        ids = frame.system, frame.component
        if ids not in self.candidates or self.candidates[ids].origin == frame.origin:  # whoever came first
            self.candidates[ids] = VehicleCandidate.of(frame)
        return True

    def found(self, system_id: int | None) -> VehicleCandidate | None:
        """Return the first autopilot received with *system_id* (None: any id), or None."""
        return next((c for c in self.candidates.values() if system_id in (None, c.system)), None)

    def signs(self, candidate: VehicleCandidate) -> bool:
        """Return whether *candidate* has sent a signed HEARTBEAT."""
        return (candidate.system, candidate.component) in self._signing


def choose(candidates: Sequence[VehicleCandidate]) -> VehicleCandidate:
    """Return the only autopilot of *candidates*.

    Raises
    ------
    UsageError
        There are several; the message lists them.
    """
    if len(candidates) > 1:
        names = " and ".join(str(c) for c in candidates)
        raise UsageError(f"{len(candidates)} autopilots are on this link: {names}. Select one with --system-id")
    return candidates[0]


def no_vehicle_error(
    description: str,
    timeout: float,
    system_id: int | None,
    candidates: Mapping[tuple[int, int], VehicleCandidate],
    heard: Iterable[tuple[int, int]],
    bad_data: int,
) -> NoVehicle:
    """Return the error for a search without a vehicle. It lists the senders received instead."""
    others = sorted({system for system, _ in heard})
    if candidates:
        return NoVehicle(
            f"no autopilot with system id {system_id} within {timeout:g} s on {description}. Found: "
            + " and ".join(str(c) for c in candidates.values())
        )
    if others:
        received = f"only other stations sent messages (system ids {', '.join(map(str, others))})"
    elif bad_data:
        received = f"data was received, but it is not MAVLink. {not_mavlink_advice(description)}"
    else:
        received = "nothing was received. Check that the vehicle is on, and the port"
    return NoVehicle(f"no HEARTBEAT of an autopilot within {timeout:g} s on {description}: {received}")


_CURES = {
    Refusal.UNSIGNED: "the vehicle has no signing key for this link. Set one up (Mission Planner: Setup, Advanced, "
    "MAVLink Signing; MAVProxy: signing setup), or omit --signing-key",
    Refusal.WRONG: "the key differs from the vehicle's key. Use the key that the vehicle was set up with",
    Refusal.OLD: "the messages may be a replayed recording, or the vehicle does not receive our messages and so has "
    "not set its clock. Check the uplink",
}


def not_believed(signer: Signer, description: str) -> SigningMismatch:
    """Return the error for a search in which no message was signed with the user's key."""
    worst, _ = signer.refused.most_common(1)[0]
    return SigningMismatch(
        f"messages are received on {description}, but none is valid ({refusals(signer)}): {_CURES[worst]}"
    )


def cannot_be_commanded(candidate: VehicleCandidate, description: str) -> SigningMismatch:
    """Return the error for a vehicle that signs its messages and does not answer unsigned ones."""
    return SigningMismatch(
        f"{candidate} on {description} signs its messages and does not answer: it accepts only messages signed "
        "with its key. Use --signing-key FILE or --signing-passphrase"
    )
