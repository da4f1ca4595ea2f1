"""Telling the autopilot from everybody else who talks on a link."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Self

from gcs_autotune.errors import NoVehicle, UsageError
from gcs_autotune.link.identity import VehicleIdentity, type_name
from gcs_autotune.link.signing import is_signed
from gcs_autotune.link.wire import Frame, Message, mavlink

__all__ = ["Candidate", "Sightings", "choose", "is_autopilot", "nobody_found"]


def is_autopilot(heartbeat: Message) -> bool:
    """Whether a HEARTBEAT comes from an autopilot (a ground station or camera says INVALID)."""
    return bool(heartbeat.autopilot != mavlink.MAV_AUTOPILOT_INVALID)


@dataclass(frozen=True, slots=True)
class Candidate:
    """An autopilot heard on the link."""

    system: int
    component: int
    autopilot: int
    vehicle_type: int
    armed: bool
    custom_mode: int
    origin: str = ""

    @classmethod
    def of(cls, frame: Frame) -> Self:
        """Return the sender of a HEARTBEAT."""
        m = frame.message
        armed = bool(m.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)
        return cls(
            frame.system, frame.component, int(m.autopilot), int(m.type), armed, int(m.custom_mode), frame.origin
        )

    def identity(self, *, version: str = "", uid: str = "") -> VehicleIdentity:
        """Return it as an identity."""
        return VehicleIdentity(self.system, self.component, self.autopilot, self.vehicle_type, version=version, uid=uid)

    def __str__(self) -> str:
        return f"system {self.system} ({type_name(self.vehicle_type)})"


class Sightings:
    """The autopilots heard while none has been chosen yet; ``candidates`` by (system, component)."""

    def __init__(self) -> None:
        self.candidates: dict[tuple[int, int], Candidate] = {}
        self._signing: set[tuple[int, int]] = set()

    def take(self, frame: Frame) -> bool:
        """Note the sender when *frame* is an autopilot's heartbeat; return whether it is."""
        if not (frame.name == "HEARTBEAT" and is_autopilot(frame.message)):
            return False
        if is_signed(frame):
            self._signing.add((frame.system, frame.component))
        ids = frame.system, frame.component
        if ids not in self.candidates or self.candidates[ids].origin == frame.origin:  # whoever came first
            self.candidates[ids] = Candidate.of(frame)
        return True

    def found(self, system_id: int | None) -> Candidate | None:
        """Return the first one with *system_id* (None: with any), None when there is none."""
        return next((c for c in self.candidates.values() if system_id in (None, c.system)), None)

    def signs(self, candidate: Candidate) -> bool:
        """Whether it was heard to sign its messages."""
        return (candidate.system, candidate.component) in self._signing


def choose(candidates: Sequence[Candidate]) -> Candidate:
    """Return the only autopilot.

    Raises
    ------
    UsageError
        When there are several; the message names them.
    """
    if len(candidates) > 1:
        names = " and ".join(str(c) for c in candidates)
        raise UsageError(f"{len(candidates)} autopilots are on this link: {names}; say which by its system id")
    return candidates[0]


def nobody_found(
    description: str,
    timeout: float,
    system_id: int | None,
    candidates: Mapping[tuple[int, int], Candidate],
    heard: Iterable[tuple[int, int]],
    bad_data: int,
) -> NoVehicle:
    """Return the error for a search that found nothing, with what was there instead."""
    others = sorted({system for system, _ in heard})
    if candidates:
        return NoVehicle(
            f"no autopilot with system id {system_id} within {timeout:g} s on {description}; there is "
            + " and ".join(str(c) for c in candidates.values())
        )
    if others:
        seen = f"only other stations were heard (system ids {', '.join(map(str, others))})"
    elif bad_data:
        seen = "bytes came in, but none of them MAVLink; is the baud rate right?"
    else:
        seen = "nothing came in at all; is the vehicle on, and is this the right port?"
    return NoVehicle(f"no autopilot's heartbeat within {timeout:g} s on {description}: {seen}")
