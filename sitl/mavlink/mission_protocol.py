"""The mission protocol on the vehicle's side: upload, download, clearing, and how far the mission has come.

Source: ArduPilot's ``libraries/GCS_MAVLink/MissionItemProtocol``, ``AP_Mission``. One thing differs: an upload that is
refused or interrupted leaves the mission as it was. The firmware overwrites item by item as they arrive.
"""

from __future__ import annotations

import math

from sitl.autopilot import INFO, MOST_ITEMS, WARNING, Command, Mission, MissionItem
from sitl.mavlink.dialect import Message, mavlink
from sitl.mavlink.port import Port
from sitl.mavlink.telemetry import make_mission_current
from sitl.place import to_globe

__all__ = ["MissionProtocol"]

_FLOWN: int = mavlink.MAV_MISSION_TYPE_MISSION
_FENCE: int = mavlink.MAV_MISSION_TYPE_FENCE
_ACCEPTED: int = mavlink.MAV_MISSION_ACCEPTED
_ERROR: int = mavlink.MAV_MISSION_ERROR
_DENIED: int = mavlink.MAV_MISSION_DENIED
_ASK_AGAIN_MS, _TIMEOUT_MS = 1000, 8000
_RESERVED = (0, 1)
_FRAMES = {
    mavlink.MAV_FRAME_MISSION: mavlink.MAV_FRAME_GLOBAL,
    mavlink.MAV_FRAME_GLOBAL: mavlink.MAV_FRAME_GLOBAL,
    mavlink.MAV_FRAME_GLOBAL_INT: mavlink.MAV_FRAME_GLOBAL,
    mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT: mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT,
    mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT: mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT,
    mavlink.MAV_FRAME_GLOBAL_TERRAIN_ALT: mavlink.MAV_FRAME_GLOBAL_TERRAIN_ALT,
    mavlink.MAV_FRAME_GLOBAL_TERRAIN_ALT_INT: mavlink.MAV_FRAME_GLOBAL_TERRAIN_ALT,
}
"""Frame of an item that is taken -> frame in which it is returned."""
_MOST_LATITUDE, _MOST_LONGITUDE = 900_000_000, 1_800_000_000
_MOST_ALTITUDE = 83_000.0
"""m; ArduPilot's LOCATION_ALT_MAX_M."""


class MissionProtocol:
    """One station at a time uploads; the others are denied until it is done, cancelled or silent for 8 s."""

    def __init__(self, port: Port) -> None:
        self._port = port
        self._items: list[MissionItem] = []
        self._count = 0
        self._uploader: tuple[int, int] | None = None
        self._heard_ms = self._requested_ms = 0

    # -- upload

    def count(self, message: Message) -> None:
        """Take MISSION_COUNT: ask for the items, one after the other."""
        if message.mission_type != _FLOWN:
            self._ack(_sender(message), mavlink.MAV_MISSION_UNSUPPORTED, message.mission_type)
            return
        if not self._may_begin(message):
            return
        if message.count > MOST_ITEMS:
            self._ack(_sender(message), mavlink.MAV_MISSION_NO_SPACE)
            self._say(WARNING, f"Only {MOST_ITEMS} items are supported")
            return
        self._items, self._count = [], message.count
        self._uploader, self._heard_ms = _sender(message), self._ms
        self._go_on()

    def item(self, message: Message) -> None:
        """Take MISSION_ITEM_INT or MISSION_ITEM: check it and ask for the next one."""
        sender = _sender(message)
        if self._uploader is None or message.mission_type != _FLOWN:
            return
        if message.seq != len(self._items):
            self._ack(sender, mavlink.MAV_MISSION_INVALID_SEQUENCE)
            return
        if sender != self._uploader:
            self._ack(sender, _DENIED)
            return
        if message.get_type() == "MISSION_ITEM" and not self._items:
            self._say(WARNING, "got MISSION_ITEM; GCS should send MISSION_ITEM_INT")
        fault, item = _read(message)
        if item is None:
            self._end(fault)
            return
        self._items.append(item)
        self._heard_ms = self._ms
        self._go_on()

    def tick(self) -> None:
        """Ask again for an item that does not come; give up when nothing has come for 8 s."""
        if self._uploader is None:
            return
        if self._ms - self._heard_ms > _TIMEOUT_MS:
            self._say(WARNING, "Mission upload timeout")
            self._end(mavlink.MAV_MISSION_OPERATION_CANCELLED)
        elif self._ms - self._requested_ms > _ASK_AGAIN_MS:
            self._go_on()

    # -- the other questions

    def list(self, message: Message) -> None:
        """Answer MISSION_REQUEST_LIST with the number of items."""
        if self._is_uploading(message):
            return
        counts = {_FLOWN: len(self._mission.items), _FENCE: len(self._port.fence)}
        count = counts.get(message.mission_type, 0)
        self._port.send(mavlink.MAVLink_mission_count_message(*_sender(message), count, message.mission_type))

    def request(self, message: Message) -> None:
        """Answer MISSION_REQUEST_INT or MISSION_REQUEST with an item; the firmware shows home as item 0."""
        if self._is_uploading(message):
            return
        if message.mission_type == _FENCE:
            self._send_fence(message)
            return
        items = self._mission.items
        if message.mission_type != _FLOWN or 0 < message.seq >= len(items):
            self._port.send(mavlink.MAVLink_mission_count_message(*_sender(message), len(items), _FLOWN))
            self._ack(_sender(message), _ERROR)
            return
        self._send_item(message, self._home() if message.seq == 0 else items[message.seq])

    def clear(self, message: Message) -> None:
        """Forget the mission (MISSION_CLEAR_ALL)."""
        if message.mission_type not in (_FLOWN, mavlink.MAV_MISSION_TYPE_ALL):
            self._ack(_sender(message), mavlink.MAV_MISSION_UNSUPPORTED, message.mission_type)
        elif self._may_begin(message):
            cleared = self._mission.clear(armed=self._port.vehicle.autopilot.armed)
            self._ack(_sender(message), _ACCEPTED if cleared else _ERROR)

    def set_current(self, message: Message) -> None:
        """Go on with another item (MISSION_SET_CURRENT); MISSION_CURRENT with that number confirms it."""
        autopilot = self._port.vehicle.autopilot
        if autopilot.set_mission_item(message.seq):
            self._port.send(make_mission_current(self._port.vehicle, message.seq))

    def send_reached(self) -> None:
        """Send MISSION_ITEM_REACHED for what has been reached."""
        reached = self._port.vehicle.autopilot.reached_items
        if reached:
            for index in reached:
                self._port.send(mavlink.MAVLink_mission_item_reached_message(index))
            reached.clear()

    # -- inside

    @property
    def _ms(self) -> int:
        return self._port.vehicle.ms

    @property
    def _mission(self) -> Mission:
        return self._port.vehicle.autopilot.mission

    def _say(self, severity: int, text: str) -> None:
        self._port.vehicle.autopilot.say(severity, text)

    def _may_begin(self, message: Message) -> bool:
        """Return whether no other station uploads; one's own upload is cancelled."""
        if self._uploader not in (None, _sender(message)):
            self._ack(_sender(message), _DENIED)
            return False
        self._uploader = None
        return True

    def _is_uploading(self, message: Message) -> bool:
        if self._uploader is not None:
            self._ack(_sender(message), _DENIED, message.mission_type)
        return self._uploader is not None

    def _go_on(self) -> None:
        """Ask for the next item, or store the mission when all are there."""
        assert self._uploader is not None
        if len(self._items) == self._count:
            self._mission.store(self._items)
            self._say(INFO, "Flight plan received")
            self._end(_ACCEPTED)
            return
        self._requested_ms = self._ms
        self._port.send(mavlink.MAVLink_mission_request_message(*self._uploader, len(self._items), _FLOWN))

    def _end(self, result: int) -> None:
        assert self._uploader is not None
        self._ack(self._uploader, result)
        self._uploader, self._items = None, []

    def _ack(self, receiver: tuple[int, int], result: int, kind: int = _FLOWN) -> None:
        self._port.send(mavlink.MAVLink_mission_ack_message(*receiver, result, kind))

    def _home(self) -> MissionItem:
        home = self._port.vehicle.autopilot.home
        latitude, longitude = (0, 0) if home is None else to_globe(home)
        return MissionItem(Command.WAYPOINT, mavlink.MAV_FRAME_GLOBAL, latitude=latitude, longitude=longitude)

    def _send_item(self, message: Message, item: MissionItem) -> None:
        current = int(message.seq == self._mission.current)
        whole = message.get_type() == "MISSION_REQUEST_INT"
        kind = mavlink.MAVLink_mission_item_int_message if whole else mavlink.MAVLink_mission_item_message
        scale = 1.0 if whole or not item.command.has_place else 1e-7
        x, y = (item.latitude, item.longitude) if whole else (item.latitude * scale, item.longitude * scale)
        about = (message.seq, item.frame, int(item.command), current, 1)
        self._port.send(kind(*_sender(message), *about, *item.parameters, x, y, item.altitude, _FLOWN))

    def _send_fence(self, message: Message) -> None:
        if not 0 <= message.seq < len(self._port.fence):
            return
        command, first, latitude, longitude = self._port.fence[message.seq]
        self._port.send(
            mavlink.MAVLink_mission_item_int_message(
                *_sender(message), message.seq, mavlink.MAV_FRAME_GLOBAL, command, 0, 1,
                first, 0.0, 0.0, 0.0, round(latitude * 1e7), round(longitude * 1e7), 0.0, _FENCE,
            )
        )  # fmt: skip


def _sender(message: Message) -> tuple[int, int]:
    return message.get_srcSystem(), message.get_srcComponent()


_PLACED_NAN = 3
"""Index of the parameter that may be NaN where a heading is meant: waypoints and loitering without limit."""
_INVALID = (
    mavlink.MAV_MISSION_INVALID_PARAM1,
    mavlink.MAV_MISSION_INVALID_PARAM2,
    mavlink.MAV_MISSION_INVALID_PARAM3,
    mavlink.MAV_MISSION_INVALID_PARAM4,
)


def _read(message: Message) -> tuple[int, MissionItem | None]:
    """Return (MAV_MISSION_RESULT, item); no item when the firmware would refuse it."""
    parameters = (message.param1, message.param2, message.param3, message.param4)
    may_be_nan = message.command in (Command.WAYPOINT, Command.LOITER_UNLIMITED)
    for index, value in enumerate(parameters):
        if math.isinf(value) or (math.isnan(value) and not (may_be_nan and index == _PLACED_NAN)):
            return _INVALID[index], None
    if message.command in _RESERVED:
        return mavlink.MAV_MISSION_INVALID, None
    if message.command not in list(Command):
        return mavlink.MAV_MISSION_UNSUPPORTED, None
    command = Command(message.command)
    kept = tuple(0.0 if math.isnan(value) else float(value) for value in parameters)
    if not command.has_place:
        return _ACCEPTED, MissionItem(command, mavlink.MAV_FRAME_GLOBAL, (kept[0], kept[1], kept[2], kept[3]))
    scale = 1 if message.get_type() == "MISSION_ITEM_INT" else 1e7
    if not all(math.isfinite(value) for value in (message.x, message.y)):
        return mavlink.MAV_MISSION_INVALID_PARAM5_X, None
    latitude, longitude = round(message.x * scale), round(message.y * scale)
    if abs(latitude) > _MOST_LATITUDE:
        return mavlink.MAV_MISSION_INVALID_PARAM5_X, None
    if abs(longitude) > _MOST_LONGITUDE:
        return mavlink.MAV_MISSION_INVALID_PARAM6_Y, None
    if not abs(message.z) < _MOST_ALTITUDE:
        return mavlink.MAV_MISSION_INVALID_PARAM7, None
    if message.frame not in _FRAMES:
        return mavlink.MAV_MISSION_UNSUPPORTED_FRAME, None
    place = (latitude, longitude, float(message.z))
    return _ACCEPTED, MissionItem(command, _FRAMES[message.frame], (kept[0], kept[1], kept[2], kept[3]), *place)
