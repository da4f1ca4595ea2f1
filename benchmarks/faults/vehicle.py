"""A simulated vehicle in this process, whose state can be read directly instead of over the link."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from benchmarks.faults.fault import Fault
from benchmarks.faults.link import FaultyLink
from benchmarks.faults.station import STICK_PERIOD, Order, OtherStation, order_in
from gcs_autotune.link import MemoryLink, Transport
from gcs_autotune.mavlink import Framer
from gcs_autotune.workflow import Connection
from sitl import Server, open_vehicle

__all__ = ["Condition", "FaultyConnection", "VehicleAsFound"]

_NEUTRAL = 1500
_WIDTH, _OWN_WIDTH = 5, 50
"""Largest distance from neutral [us] that counts as neutral. The second holds if the autopilot's loops steer.

It is a tenth of full output, which these loops may need against wind and drift.
"""
_STEERS_ITSELF = {"rover": frozenset({1}), "sub": frozenset({0, 2})}
"""Modes in which the autopilot's loops steer with centred sticks: ACRO; STABILIZE, ALT_HOLD."""


@dataclass(frozen=True, slots=True)
class Condition:
    """State of a vehicle: ``mode`` number, armed or not, outputs [us] and all parameters.

    ``overridden``: its sticks are overridden. ``steers_itself``: the autopilot's loops steer.
    """

    mode: int
    armed: bool
    outputs: tuple[int, ...]
    parameters: Mapping[str, float]
    overridden: bool = False
    steers_itself: bool = False

    @property
    def is_neutral(self) -> bool:
        """Return whether all outputs are neutral (0: no pulse)."""
        width = _OWN_WIDTH if self.steers_itself else _WIDTH
        return all(pwm == 0 or abs(pwm - _NEUTRAL) <= width for pwm in self.outputs)

    def differs_from(self, found: Condition, proved: Mapping[str, float]) -> list[str]:
        """Return descriptions of what differs from the state *found*, and for parameters also from *proved*."""
        differences = [] if self.is_neutral else [f"outputs {self.outputs}"]
        if self.overridden:
            differences.append("sticks overridden")
        if self.mode != found.mode:
            differences.append(f"mode {self.mode}, found {found.mode}")
        if self.armed != found.armed:
            differences.append(f"armed {self.armed}, found {found.armed}")
        for name, value in self.parameters.items():
            if value not in (found.parameters[name], proved.get(name, found.parameters[name])):
                differences.append(f"{name} {value:g}, found {found.parameters[name]:g}")
        held = {n: self.parameters[n] for n in proved}
        if proved and held != proved and any(held[n] == v != found.parameters[n] for n, v in proved.items()):
            differences.append("only some of the proved parameters")
        return differences


class VehicleAsFound:
    """One simulated vehicle. Its time continues from one connection to the next.

    ``writes`` : (name, value, journal on disk at that moment) of every received PARAM_SET. ``deaf_to`` : parameters
    whose PARAM_SET is ignored, with all that arrived with it. ``station`` : another station on its own link.
    ``ordered`` : orders of the tool that may undo orders of this station.
    """

    def __init__(self, name: str, *, seed: int, parameters: Mapping[str, float] | None = None) -> None:
        self.server: Server = open_vehicle(name, seed=seed, parameters=parameters)
        self.writes: list[tuple[str, float, str]] = []
        self.deaf_to: set[str] = set()
        self.journal: Path | None = None
        self.station: OtherStation | None = None
        self.ordered: list[Order] = []
        self._framer = Framer()

    def receive(self, data: bytes) -> None:
        """Receive bytes from the ground station, and record orders and writes."""
        frames = list(self._framer.feed(data))
        now, mode = self.server.now, self.server.vehicle.autopilot.mode.number
        self.ordered += [order for f in frames if (order := order_in(f.message, now, mode)) is not None]
        writes = [f.message for f in frames if f.name == "PARAM_SET"]
        for message in writes:
            path = self.journal
            text = path.read_text(encoding="utf-8") if path is not None and path.exists() else ""
            self.writes.append((str(message.param_id), float(message.param_value), text))
        if not any(str(message.param_id) in self.deaf_to for message in writes):
            self.server.receive(data)

    def condition(self) -> Condition:
        """Return the state of the vehicle."""
        vehicle = self.server.vehicle
        autopilot = vehicle.autopilot
        return Condition(
            autopilot.mode.number,
            autopilot.armed,
            tuple(autopilot.pwm),
            dict(vehicle.parameters.values),
            autopilot.rc.is_overridden(autopilot.ms),
            autopilot.armed and autopilot.mode.number in _STEERS_ITSELF[vehicle.data.firmware],
        )

    def wait(self, seconds: float) -> None:
        """Simulate *seconds* without a connection."""
        self.server.advance_to(self.server.now + seconds)

    def connection(self, faults: Sequence[Fault] = (), **options: Any) -> FaultyConnection:
        """Return a connection to the vehicle. Its clock starts at zero at every opening."""
        return FaultyConnection(vehicle=self, faults=tuple(faults), options=options)


class _Peer:
    """The vehicle as the peer of a link whose clock starts at zero now."""

    def __init__(self, vehicle: VehicleAsFound) -> None:
        self._vehicle = vehicle
        self._server = vehicle.server
        self._offset = vehicle.server.now

    def receive(self, data: bytes) -> None:
        self._vehicle.receive(data)

    def advance_to(self, t: float) -> bytes:
        station, until, data = self._vehicle.station, self._offset + t, b""
        while station is not None and self._server.now < min(until, station.sticks_until) - 0.5 * STICK_PERIOD:
            station.steer()
            data += self._server.advance_to(min(self._server.now + STICK_PERIOD, until))
        return data + self._server.advance_to(until)


@dataclass(frozen=True)
class FaultyConnection(Connection):
    """A connection within this process, with faults."""

    uri: str = "memory"
    vehicle: Any = None
    faults: tuple[Fault, ...] = ()
    options: Mapping[str, Any] = field(default_factory=dict)
    opened: list[FaultyLink] = field(default_factory=list)

    def open(self) -> Transport:
        link = FaultyLink(MemoryLink(_Peer(self.vehicle)), self.faults, **self.options)
        self.opened.append(link)
        return link


def events(journal: str) -> list[dict[str, Any]]:
    """Return the events of the complete lines of a journal."""
    found = []
    for line in journal.splitlines():
        try:
            found.append(json.loads(line))
        except ValueError:
            continue
    return found
