"""A small MAVLink router: one vehicle, us, and other stations that send what a test specifies.

``repeats`` True sends every frame to every station, as UDP broadcast does; False routes as MAVProxy, mavlink-router and
ArduPilot do: what is addressed to somebody goes to him only, heartbeats and answers of the vehicle to everybody.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink
from scripted_vehicle import ScriptedVehicle

HEARTBEAT = mavlink.MAVLink_heartbeat_message(mavlink.MAV_TYPE_GCS, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, 4, 3)


class Router:
    """Implements ``Peer``: the vehicle with its other stations."""

    def __init__(self, vehicle: ScriptedVehicle, *, repeats: bool = False) -> None:
        self.vehicle, self.repeats = vehicle, repeats
        self.habits: list[tuple[Any, float, Callable[[], Any], list[float]]] = []
        self._out = bytearray()

    def station(self, system: int, component: int = 190) -> Any:
        """Bring in a ground station with a heartbeat; return what packs its messages."""
        packer = mavlink.MAVLink(None, srcSystem=system, srcComponent=component)
        self.every(packer, 1.0, lambda: HEARTBEAT)
        return packer

    def every(self, station: Any, period: float, make: Callable[[], Any]) -> None:
        self.habits.append((station, period, make, [self.vehicle.time]))

    def say(self, station: Any, message: Any) -> None:
        frame = message.pack(station)
        self.vehicle.receive(frame)
        if self.repeats or message.get_type() == "HEARTBEAT":
            self._out += frame

    def receive(self, data: bytes) -> None:
        self.vehicle.receive(data)

    def advance_to(self, t: float) -> bytes:
        while self.vehicle.time + 0.02 <= t + 1e-9:
            for station, period, make, due in self.habits:
                if self.vehicle.time >= due[0]:
                    due[0] += period
                    self.say(station, make())
            self._out += self.vehicle.advance_to(self.vehicle.time + 0.02)
        out, self._out = bytes(self._out), bytearray()
        return out
