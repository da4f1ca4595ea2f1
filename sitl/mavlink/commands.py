"""COMMAND_LONG and COMMAND_INT: a table of known commands, each answered by COMMAND_ACK."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence

from sitl.autopilot import WARNING
from sitl.mavlink.dialect import Message, mavlink
from sitl.mavlink.port import Port

__all__ = ["COMMANDS", "handle_command", "handle_set_mode"]

_ACCEPTED: int = mavlink.MAV_RESULT_ACCEPTED
_DENIED: int = mavlink.MAV_RESULT_DENIED
_UNSUPPORTED: int = mavlink.MAV_RESULT_UNSUPPORTED
_FAILED: int = mavlink.MAV_RESULT_FAILED
_FORCE_ARM = 21196
_FORCE_REBOOT = 20190226
_CUSTOM_MODE_ENABLED = 1


def _whole(value: float) -> int:
    """Return an integer that was sent as a float, or -1 if it is not whole."""
    return int(value) if math.isfinite(value) else -1


def _set_mode(port: Port, p: Sequence[float]) -> int:
    if not _whole(p[0]) & _CUSTOM_MODE_ENABLED:
        return _UNSUPPORTED
    return _ACCEPTED if port.vehicle.autopilot.set_mode(_whole(p[1])) else _FAILED


def _arm(port: Port, p: Sequence[float]) -> int:
    autopilot = port.vehicle.autopilot
    wanted = _whole(p[0])
    if wanted not in (0, 1):
        return _UNSUPPORTED
    done = autopilot.arm(force=_whole(p[1]) == _FORCE_ARM) if wanted else autopilot.disarm()
    return _ACCEPTED if done else _FAILED


def _set_message_interval(port: Port, p: Sequence[float]) -> int:
    message, interval = _whole(p[0]), p[1]
    if port.streams.interval(message) is None or not math.isfinite(interval):
        port.vehicle.autopilot.say(WARNING, f"No ap_message for mavlink id ({message})")
        return _DENIED
    if port.streams.is_too_fast(interval):
        text = "Requested rate for message too fast. Increase SCHED_LOOP_RATE"
        port.vehicle.autopilot.say(WARNING, text[:50])
        return _DENIED
    port.streams.request(message, interval, port.now_us)
    return _ACCEPTED


def _get_message_interval(port: Port, p: Sequence[float]) -> int:
    message = _whole(p[0])
    interval = port.streams.interval(message)
    if interval is None:
        return _FAILED
    port.send(mavlink.MAVLink_message_interval_message(message, interval))
    return _ACCEPTED


def _request_message(port: Port, p: Sequence[float]) -> int:
    message = _whole(p[0])
    if port.streams.interval(message) is None:
        return _FAILED
    port.send_now(message)
    return _ACCEPTED


def _request_capabilities(port: Port, p: Sequence[float]) -> int:
    if _whole(p[0]) != 1:
        return _DENIED
    port.send_now(mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION)
    return _ACCEPTED


def _reboot(port: Port, p: Sequence[float]) -> int:
    autopilot = port.vehicle.autopilot
    if _whole(p[0]) != 1:
        return _UNSUPPORTED
    if autopilot.armed and _whole(p[5]) != _FORCE_REBOOT:
        return _FAILED
    port.reboot_soon()
    return _ACCEPTED


def _change_speed(port: Port, p: Sequence[float]) -> int:
    done = math.isfinite(p[1]) and port.vehicle.autopilot.mode.set_speed(p[1])
    return _ACCEPTED if done else _FAILED


def _set_mission_item(port: Port, p: Sequence[float]) -> int:
    done = _whole(p[0]) >= 0 and port.vehicle.autopilot.set_mission_item(_whole(p[0]))
    return _ACCEPTED if done else _FAILED


def _start_mission(port: Port, p: Sequence[float]) -> int:
    if p[0] != 0.0 or p[1] != 0.0:
        return _DENIED
    return _enter(port, "AUTO")


def _return_home(port: Port, p: Sequence[float]) -> int:
    return _enter(port, "RTL")


def _enter(port: Port, name: str) -> int:
    autopilot = port.vehicle.autopilot
    number = next((mode.number for mode in autopilot.modes.values() if mode.name == name), None)
    if number is None:
        return _UNSUPPORTED
    return _ACCEPTED if autopilot.set_mode(number) else _FAILED


_SCRIPTING_STOP, _SCRIPTING_RESTART = 2, 3


def _scripting(port: Port, p: Sequence[float]) -> int:
    if _whole(p[0]) not in (_SCRIPTING_STOP, _SCRIPTING_RESTART):
        return _UNSUPPORTED
    if port.vehicle.autopilot.scripts is not None and _whole(p[0]) == _SCRIPTING_RESTART:
        port.vehicle.autopilot.scripts.restart()
    return _ACCEPTED


def _refuse(port: Port, p: Sequence[float]) -> int:
    return _FAILED


COMMANDS: Mapping[int, Callable[[Port, Sequence[float]], int]] = {
    mavlink.MAV_CMD_DO_SET_MODE: _set_mode,
    mavlink.MAV_CMD_COMPONENT_ARM_DISARM: _arm,
    mavlink.MAV_CMD_SET_MESSAGE_INTERVAL: _set_message_interval,
    mavlink.MAV_CMD_GET_MESSAGE_INTERVAL: _get_message_interval,
    mavlink.MAV_CMD_REQUEST_MESSAGE: _request_message,
    mavlink.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES: _request_capabilities,
    mavlink.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN: _reboot,
    mavlink.MAV_CMD_DO_CHANGE_SPEED: _change_speed,
    mavlink.MAV_CMD_DO_SET_MISSION_CURRENT: _set_mission_item,
    mavlink.MAV_CMD_MISSION_START: _start_mission,
    mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH: _return_home,
    mavlink.MAV_CMD_DO_SET_SERVO: _refuse,
    mavlink.MAV_CMD_SCRIPTING: _scripting,
}
"""MAV_CMD -> function that executes the command with its seven parameters and returns a MAV_RESULT."""


def handle_command(port: Port, message: Message) -> None:
    """Execute COMMAND_LONG or COMMAND_INT and acknowledge it to its sender."""
    if message.get_type() == "COMMAND_INT":
        place = (message.x, message.y, message.z)
    else:
        place = (message.param5, message.param6, message.param7)
    parameters = (message.param1, message.param2, message.param3, message.param4, *place)
    act = COMMANDS.get(message.command)
    result = _UNSUPPORTED if act is None else act(port, parameters)
    sender = (message.get_srcSystem(), message.get_srcComponent())
    port.send(mavlink.MAVLink_command_ack_message(message.command, result, 0, 0, *sender))


def handle_set_mode(port: Port, message: Message) -> None:
    """Execute the old SET_MODE message and acknowledge it, as ArduPilot does."""
    result = _set_mode(port, (float(message.base_mode), float(message.custom_mode)))
    sender = (message.get_srcSystem(), message.get_srcComponent())
    port.send(mavlink.MAVLink_command_ack_message(mavlink.MAVLINK_MSG_ID_SET_MODE, result, 0, 0, *sender))
