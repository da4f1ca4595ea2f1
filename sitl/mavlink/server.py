"""The vehicle as seen by a ground station: bytes and time in, bytes out. It does no input or output itself."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Mapping
from typing import Any

from sitl.mavlink.commands import handle_command, handle_set_mode
from sitl.mavlink.control import (
    handle_attitude_target,
    handle_global_target,
    handle_local_target,
    handle_manual_control,
    handle_override,
)
from sitl.mavlink.dialect import Message, mavlink, parse
from sitl.mavlink.file_transfer import FileTransfer
from sitl.mavlink.mission_protocol import MissionProtocol
from sitl.mavlink.parameter_protocol import ParameterProtocol
from sitl.mavlink.port import COMPONENT, Port
from sitl.mavlink.signing import handle_setup_signing
from sitl.mavlink.streams import STREAM_GROUPS, Streams
from sitl.mavlink.telemetry import available_messages
from sitl.vehicle import Vehicle

__all__ = ["HANDLERS", "Server"]

_TEXT_LENGTH = 50
_ROUNDING = 1e-6


class Server(Port):
    """Connects a vehicle to a link without input or output: :meth:`receive` accepts bytes, :meth:`advance_to` returns
    the bytes to send.

    Received bytes are processed at the next loop tick, after the link's delay. Messages sent at a tick leave at that
    tick, after the delay. Time stamps are those of the measurement.
    """

    def __init__(self, vehicle: Vehicle) -> None:
        super().__init__(vehicle)
        self.now = 0.0
        self._up_ticks = round(vehicle.data.up_delay * vehicle.rate)
        self._down_ticks = round(vehicle.data.down_delay * vehicle.rate)
        self._uplink: deque[tuple[int, bytes, bool]] = deque()
        self._downlink: deque[tuple[int, bytes]] = deque()
        self._elsewhere: Any = mavlink.MAVLink(None)
        self._elsewhere.robust_parsing = True
        self.parameters = ParameterProtocol(self)
        self.missions = MissionProtocol(self)
        self.files = FileTransfer(self)
        self._announce()

    def receive(self, data: bytes) -> None:
        """Receive bytes that arrive at the present time."""
        if data:
            self._uplink.append((self.vehicle.tick + max(1, self._up_ticks), bytes(data), False))

    def receive_elsewhere(self, data: bytes) -> None:
        """Receive bytes from another station, which arrive now on another port of the vehicle.

        As in the firmware, acknowledgements and requested messages for that station are sent only at its own port. The
        changes that it makes appear in telemetry, and a written parameter is sent at every port.
        """
        if data:
            self._uplink.append((self.vehicle.tick + 1, bytes(data), True))

    def advance_to(self, t: float) -> bytes:
        """Run until *t* [s] and return the bytes sent until then. Nothing happens if *t* is not in the future."""
        if not math.isfinite(t) or t <= self.now:
            return b""
        self.now = t
        last = math.floor(t * self.vehicle.rate + _ROUNDING)
        arrived = bytearray()
        while self.vehicle.tick < last:
            self._tick()
            if self._out:
                self._downlink.append((self.vehicle.tick + self._down_ticks, bytes(self._out)))
                self._out.clear()
            while self._downlink and self._downlink[0][0] <= self.vehicle.tick:
                arrived += self._downlink.popleft()[1]
        return bytes(arrived)

    def _announce(self) -> None:
        autopilot = self.vehicle.autopilot
        autopilot.say(6, f"{autopilot.firmware} V4.7.0-dev (simulated {self.vehicle.data.name})")

    def _tick(self) -> None:
        vehicle = self.vehicle
        vehicle.move()
        vehicle.autopilot.ms = vehicle.ms
        while self._uplink and self._uplink[0][0] <= vehicle.tick:
            _, data, self._is_elsewhere = self._uplink.popleft()
            self._hear(data)
            self._is_elsewhere = False
        vehicle.control()
        for message_id in self.streams.due(self.now_us):
            self.send_now(message_id)
        self.parameters.tick()
        self.missions.tick()
        self.missions.send_reached()
        self._send_texts()
        if self._reboots:
            self._reboot()

    def _send_texts(self) -> None:
        texts = self.vehicle.autopilot.texts
        if texts:
            for severity, text in texts:
                self.send(mavlink.MAVLink_statustext_message(severity, text[:_TEXT_LENGTH].encode()))
            texts.clear()

    def _reboot(self) -> None:
        self._reboots = False
        self.vehicle.reboot()
        self.parameters = ParameterProtocol(self)
        self.missions = MissionProtocol(self)
        self.streams = Streams(available_messages(self.vehicle), self.vehicle.rate)
        self._announce()

    def _hear(self, data: bytes) -> None:
        for message in parse(self._elsewhere if self._is_elsewhere else self.codec, data):
            handler = HANDLERS.get(message.get_type())
            if self._is_elsewhere and not _is_order(message):
                continue  # whom it asks, and at what rates, is that port's affair
            if handler is not None and self._is_addressed(message):
                handler(self, message)

    def _is_addressed(self, message: Message) -> bool:
        system = getattr(message, "target_system", getattr(message, "target", 0))
        component = getattr(message, "target_component", 0)
        return system in (0, int(self.vehicle.parameters["MAV_SYSID"])) and component in (0, COMPONENT)


def _is_order(message: Message) -> bool:
    return message.get_type() in ORDERS and getattr(message, "command", -1) not in _QUESTIONS


def _handle_heartbeat(server: Server, message: Message) -> None:
    if server.is_from_gcs(message):
        server.vehicle.autopilot.note_gcs()


def _handle_timesync(server: Server, message: Message) -> None:
    if message.tc1 == 0:
        server.send(mavlink.MAVLink_timesync_message(server.now_us * 1000, message.ts1))


def _handle_data_stream(server: Server, message: Message) -> None:
    rate = message.req_message_rate if message.start_stop else 0
    interval = 1e6 / rate if rate else -1.0
    everything = message.req_stream_id == mavlink.MAV_DATA_STREAM_ALL
    for group, members in STREAM_GROUPS.items():
        for member in members if everything or group == message.req_stream_id else ():
            if server.streams.interval(member) is not None:
                server.streams.request(member, max(interval, 25_000.0) if rate else -1.0, server.now_us)


HANDLERS: Mapping[str, Callable[[Server, Message], None]] = {
    "HEARTBEAT": _handle_heartbeat,
    "TIMESYNC": _handle_timesync,
    "REQUEST_DATA_STREAM": _handle_data_stream,
    "COMMAND_LONG": handle_command,
    "COMMAND_INT": handle_command,
    "SET_MODE": handle_set_mode,
    "PARAM_REQUEST_LIST": lambda server, message: server.parameters.request_list(message),
    "PARAM_REQUEST_READ": lambda server, message: server.parameters.request_read(message),
    "FILE_TRANSFER_PROTOCOL": lambda server, message: server.files.handle(message),
    "PARAM_SET": lambda server, message: server.parameters.set(message),
    "RC_CHANNELS_OVERRIDE": handle_override,
    "SETUP_SIGNING": handle_setup_signing,
    "MANUAL_CONTROL": handle_manual_control,
    "MISSION_COUNT": lambda server, message: server.missions.count(message),
    "MISSION_ITEM": lambda server, message: server.missions.item(message),
    "MISSION_ITEM_INT": lambda server, message: server.missions.item(message),
    "MISSION_REQUEST_LIST": lambda server, message: server.missions.list(message),
    "MISSION_REQUEST": lambda server, message: server.missions.request(message),
    "MISSION_REQUEST_INT": lambda server, message: server.missions.request(message),
    "MISSION_CLEAR_ALL": lambda server, message: server.missions.clear(message),
    "MISSION_SET_CURRENT": lambda server, message: server.missions.set_current(message),
    "SET_ATTITUDE_TARGET": handle_attitude_target,
    "SET_POSITION_TARGET_LOCAL_NED": handle_local_target,
    "SET_POSITION_TARGET_GLOBAL_INT": handle_global_target,
}
"""Type of a received message -> its handler. All other messages are ignored."""

ORDERS = frozenset(
    {
        *("HEARTBEAT", "COMMAND_LONG", "COMMAND_INT", "SET_MODE", "PARAM_SET", "RC_CHANNELS_OVERRIDE"),
        *("MANUAL_CONTROL", "SET_ATTITUDE_TARGET", "SET_POSITION_TARGET_LOCAL_NED", "SET_POSITION_TARGET_GLOBAL_INT"),
        *("MISSION_CLEAR_ALL", "MISSION_SET_CURRENT"),
    }
)
"""Types of the messages that are executed if a station at another port sends them."""
_QUESTIONS = frozenset(
    {
        mavlink.MAV_CMD_SET_MESSAGE_INTERVAL,
        mavlink.MAV_CMD_GET_MESSAGE_INTERVAL,
        mavlink.MAV_CMD_REQUEST_MESSAGE,
        mavlink.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES,
    }
)
"""Commands that concern the port at which they arrive."""
