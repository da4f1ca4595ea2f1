"""The vehicle's MAVLink port as available to message handlers."""

from __future__ import annotations

from typing import Any

from sitl.mavlink.dialect import Message, mavlink, pack
from sitl.mavlink.streams import Reporter, Streams
from sitl.mavlink.telemetry import MESSAGES, available_messages
from sitl.vehicle import Vehicle

__all__ = ["COMPONENT", "FencePoint", "Port"]

FencePoint = tuple[int, float, float, float]
COMPONENT = 1


class Port:
    """A vehicle that sends messages at once or when its streams are due. The bytes to send are collected until a tick
    ends.
    """

    def __init__(self, vehicle: Vehicle) -> None:
        self.vehicle = vehicle
        self.codec: Any = mavlink.MAVLink(None, srcSystem=1, srcComponent=COMPONENT)
        self.codec.robust_parsing = True
        self.fence: list[FencePoint] = []
        """Items of the fence: MAV_CMD, its first parameter, latitude and longitude [deg].

        The fence is stored but not enforced.
        """
        self.streams = Streams(available_messages(vehicle), vehicle.rate)
        self._reporter = Reporter(vehicle)
        self._out = bytearray()
        self._is_elsewhere = False
        self._reboots = False

    @property
    def now_us(self) -> int:
        """Time since boot [us] for the time stamps of messages."""
        return self.vehicle.boot_us

    def send(self, message: Message) -> None:
        """Send a message. An answer to a station at another port of the vehicle is sent at that other port."""
        if self._is_elsewhere and message.get_type() != "PARAM_VALUE":
            return
        self.codec.srcSystem = int(self.vehicle.parameters["MAV_SYSID"]) & 0xFF
        self._out += pack(message, self.codec)
        self.codec.seq = (self.codec.seq + 1) % 256

    def send_now(self, message_id: int) -> None:
        """Build and send once the message of that id in :data:`~sitl.mavlink.telemetry.MESSAGES`."""
        for message in MESSAGES[message_id][0](self.vehicle):
            if self._reporter:
                self._reporter.alter(message)
            self.send(message)

    def reboot_soon(self) -> None:
        """Restart the autopilot at the end of this tick, so that the acknowledgement is still sent."""
        self._reboots = True

    def is_from_gcs(self, message: Message) -> bool:
        """Return whether *message* comes from the ground station that is allowed to control (MAV_GCS_SYSID)."""
        return bool(message.get_srcSystem() == int(self.vehicle.parameters["MAV_GCS_SYSID"]))
