"""The parameter protocol as in ArduPilot: values as C-cast floats, and no answer or PARAM_ERROR for unknown names."""

from __future__ import annotations

import math

from sitl.autopilot import WARNING, ReadOnlyParameter
from sitl.mavlink.dialect import Message, mavlink
from sitl.mavlink.port import Port

__all__ = ["HASH_NAME", "ParameterProtocol"]

HASH_NAME = "_HASH_CHECK"
_BY_NAME = -1
_NO_INDEX = 65535
_UINT32 = 5
_PER_TICK = 25
"""Parameters sent per loop while a list is sent, about as many as a real autopilot on a fast link."""


class ParameterProtocol:
    """Answers PARAM_REQUEST_LIST, PARAM_REQUEST_READ and PARAM_SET."""

    def __init__(self, port: Port) -> None:
        self._port = port
        self._store = port.vehicle.dialect
        self._cursor: int | None = None

    def request_list(self, message: Message) -> None:
        """Start sending the whole parameter list."""
        self._cursor = 0

    def request_read(self, message: Message) -> None:
        """Send one parameter by name (index -1) or index. If it does not exist, send nothing or, on newer firmware,
        PARAM_ERROR.
        """
        by_name = message.param_index == _BY_NAME
        name = _name_of(message) if by_name else self._store.name_at(message.param_index)
        if name == HASH_NAME:
            value = self._store.hash()
            self._port.send(_value_message(HASH_NAME, float(value), _UINT32, len(self._store), _NO_INDEX))
        elif name is not None and name in self._store:
            self._send(name, self._store.index_of(name))
        else:
            self._object(message, _name_of(message), message.param_index, mavlink.MAV_PARAM_ERROR_DOES_NOT_EXIST)

    def set(self, message: Message) -> None:
        """Store a value and echo the stored one. For NaN, infinity or an unknown name, send nothing or, on newer
        firmware, PARAM_ERROR.
        """
        name = _name_of(message)
        if name not in self._store:
            self._object(message, name, _BY_NAME, mavlink.MAV_PARAM_ERROR_DOES_NOT_EXIST)
            return
        try:
            taken = self._store.write(name, message.param_value)
        except ReadOnlyParameter:
            self._port.vehicle.autopilot.say(WARNING, f"Param write denied ({name})")
            self._object(message, name, _BY_NAME, mavlink.MAV_PARAM_ERROR_PERMISSION_DENIED)
            taken = True
        if taken:
            self._send(name, _NO_INDEX)
        else:
            self._object(message, name, _BY_NAME, mavlink.MAV_PARAM_ERROR_VALUE_OUT_OF_RANGE)

    def tick(self) -> None:
        """Send the next few parameters of a list in progress."""
        if self._cursor is None:
            return
        last = min(self._cursor + _PER_TICK, len(self._store))
        for index in range(self._cursor, last):
            name = self._store.name_at(index)
            assert name is not None
            self._send(name, index)
        self._cursor = None if last == len(self._store) else last

    def _object(self, message: Message, name: str, index: int, error: int) -> None:
        if self._store.answers_errors:
            sender = message.get_srcSystem(), message.get_srcComponent()
            self._port.send(mavlink.MAVLink_param_error_message(*sender, name.encode("ascii"), index, error))

    def _send(self, name: str, index: int) -> None:
        store = self._store
        self._port.send(_value_message(name, store[name], store.kind_of(name), len(store), index))


def _value_message(name: str, value: float, kind: int, count: int, index: int) -> Message:
    assert math.isfinite(value)
    return mavlink.MAVLink_param_value_message(name.encode("ascii"), value, kind, count, index)


def _name_of(message: Message) -> str:
    return str(message.param_id).split("\0", 1)[0]
