"""Rates of the sent messages, and changes of these messages by effects on the record. Such effects change only the
messages, not the craft. For them a message is converted to fields in SI units with SNAME names, and then back. ``t`` is
the time stamp [s]. ``servo`` exists if the message reports the actuators. It contains the normalised outputs ``N``,
``X`` (``Z``).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass

from sitl.mavlink.dialect import Message, mavlink
from sitl.mavlink.telemetry import MESSAGES
from sitl.place import HOME, METRES_PER_DEGREE
from sitl.vehicle import Vehicle

__all__ = ["STREAM_GROUPS", "Reporter", "Streams"]

_MASK = 0xFFFFFFFF


@dataclass(frozen=True, slots=True)
class _Field:
    """One field of a message: number = offset + scale * value, rounded if the field is an integer."""

    attribute: str
    scale: float = 1.0
    whole: bool = False
    offset: float = 0.0
    turn: float = 0.0
    """Value of the message field that corresponds to a full circle; 0 if the field is not an angle."""

    def read(self, message: Message) -> float:
        return (float(getattr(message, self.attribute)) - self.offset) / self.scale

    def write(self, message: Message, value: float) -> None:
        number = self.offset + self.scale * value
        if self.turn:
            number = number % self.turn if self.whole else math.remainder(number, self.turn)
        setattr(message, self.attribute, round(number) if self.whole else number)


_BOOT = _Field("time_boot_ms", 1e3, whole=True)
_MICROS = _Field("time_usec", 1e6, whole=True)
_DEGREE = math.degrees(1.0)
_EAST = METRES_PER_DEGREE * math.cos(math.radians(HOME[0]))

_FIELDS: Mapping[str, Mapping[str, _Field]] = {
    "ATTITUDE": {
        "t": _BOOT,
        "phi": _Field("roll", turn=math.tau),
        "theta": _Field("pitch", turn=math.tau),
        "psi": _Field("yaw", turn=math.tau),
        "p": _Field("rollspeed"),
        "q": _Field("pitchspeed"),
        "r": _Field("yawspeed"),
    },
    "LOCAL_POSITION_NED": {
        "t": _BOOT,
        "x": _Field("x"),
        "y": _Field("y"),
        "z": _Field("z"),
        "w": _Field("vz"),
    },
    "GLOBAL_POSITION_INT": {
        "t": _BOOT,
        "x": _Field("lat", 1e7 / METRES_PER_DEGREE, whole=True, offset=1e7 * HOME[0]),
        "y": _Field("lon", 1e7 / _EAST, whole=True, offset=1e7 * HOME[1]),
        "z": _Field("alt", -1e3, whole=True),
        "w": _Field("vz", 1e2, whole=True),
        "psi": _Field("hdg", 1e2 * _DEGREE, whole=True, turn=36000.0),
    },
    "VFR_HUD": {
        "psi": _Field("heading", _DEGREE, whole=True, turn=360.0),
        "z": _Field("alt", -1.0),
        "w": _Field("climb", -1.0),
    },
    "SERVO_OUTPUT_RAW": {"t": _MICROS},
    "RC_CHANNELS": {"t": _BOOT},
    "SCALED_PRESSURE2": {"t": _BOOT},
    "SYSTEM_TIME": {"t": _BOOT},
    "RAW_IMU": {"t": _MICROS},
    "HIGHRES_IMU": {"t": _MICROS},
    "GPS_RAW_INT": {"t": _MICROS},
    "VISION_POSITION_DELTA": {"t": _MICROS},
}
"""Message -> name of the quantity -> field."""
_VELOCITY = {"LOCAL_POSITION_NED": 1.0, "GLOBAL_POSITION_INT": 100.0}
"""Messages with ``vx vy`` over ground -> factor. For effects they are converted to ``u v``."""


class Reporter:
    """Applies effects to messages before they are sent."""

    def __init__(self, vehicle: Vehicle) -> None:
        self._vehicle = vehicle
        self._alters: list[Callable[[dict[str, float]], None]] = [
            effect.alter_report for effect in vehicle.effects if effect.overrides("alter_report")
        ]

    def __bool__(self) -> bool:
        return bool(self._alters)

    def alter(self, message: Message) -> None:
        """Change *message* by every effect on the record."""
        kind = message.get_type()
        fields = _FIELDS.get(kind)
        if fields is None:
            return
        values = {name: field.read(message) for name, field in fields.items()}
        if kind in _VELOCITY:
            values["u"], values["v"] = self._turned(message.vx / _VELOCITY[kind], message.vy / _VELOCITY[kind], -1.0)
        if kind == "SERVO_OUTPUT_RAW":
            pulses = [getattr(message, f"servo{n + 1}_raw") for n in range(len(self._vehicle.autopilot.pwm))]
            values.update(self._vehicle.actuators.read(pulses), servo=1.0)
        before = dict(values)
        for alter in self._alters:
            alter(values)
        for name, field in fields.items():
            if values[name] != before[name]:
                field.write(message, values[name])
                if name == "t":
                    setattr(message, field.attribute, max(getattr(message, field.attribute), 0) & _MASK)
        if kind in _VELOCITY and (values["u"], values["v"]) != (before["u"], before["v"]):
            vx, vy = self._turned(values["u"], values["v"], 1.0)
            scale = _VELOCITY[kind]
            message.vx, message.vy = (round(scale * vx), round(scale * vy)) if scale != 1.0 else (vx, vy)
        if kind == "SERVO_OUTPUT_RAW" and any(values[name] != before[name] for name in "NXZ" if name in values):
            for n, pulse in enumerate(self._vehicle.actuators.write(pulses, values)):
                setattr(message, f"servo{n + 1}_raw", pulse)

    def _turned(self, a: float, b: float, way: float) -> tuple[float, float]:
        yaw = self._vehicle.autopilot.estimate.yaw
        c, s = math.cos(yaw), way * math.sin(yaw)
        return c * a - s * b, s * a + c * b


_LONGEST_US = 2**31 - 1
_DENY_SHARE = 0.8
"""Factor in ArduPilot's rule: it denies an interval if 0.8 of it is shorter than its loop."""

STREAM_GROUPS = {
    mavlink.MAV_DATA_STREAM_EXTENDED_STATUS: (
        mavlink.MAVLINK_MSG_ID_GPS_RAW_INT,
        mavlink.MAVLINK_MSG_ID_SYS_STATUS,
        mavlink.MAVLINK_MSG_ID_MISSION_CURRENT,
        mavlink.MAVLINK_MSG_ID_NAV_CONTROLLER_OUTPUT,
        mavlink.MAVLINK_MSG_ID_POSITION_TARGET_GLOBAL_INT,
    ),
    mavlink.MAV_DATA_STREAM_RC_CHANNELS: (
        mavlink.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW,
        mavlink.MAVLINK_MSG_ID_RC_CHANNELS,
    ),
    mavlink.MAV_DATA_STREAM_POSITION: (
        mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT,
        mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED,
    ),
    mavlink.MAV_DATA_STREAM_EXTRA1: (mavlink.MAVLINK_MSG_ID_ATTITUDE, mavlink.MAVLINK_MSG_ID_PID_TUNING),
    mavlink.MAV_DATA_STREAM_EXTRA2: (mavlink.MAVLINK_MSG_ID_VFR_HUD,),
    mavlink.MAV_DATA_STREAM_EXTRA3: (
        mavlink.MAVLINK_MSG_ID_SYSTEM_TIME,
        mavlink.MAVLINK_MSG_ID_EKF_STATUS_REPORT,
    ),
    mavlink.MAV_DATA_STREAM_RAW_SENSORS: (
        mavlink.MAVLINK_MSG_ID_SCALED_PRESSURE2,
        mavlink.MAVLINK_MSG_ID_RAW_IMU,
    ),
}
"""MAV_DATA_STREAM of REQUEST_DATA_STREAM -> ids of its messages, as far as the simulator sends them."""


class Streams:
    """Message intervals in microseconds. A message is due at the first tick at or after each multiple of its
    interval.

    So on a 50 Hz loop a rate of 40 Hz has gaps of 20 and 40 ms, and 10 Hz occurs at whole tenths of a second. *rate*:
    rate of the loop [Hz].
    """

    def __init__(self, available: Iterable[int], rate: int) -> None:
        self.available = frozenset(available)
        self._loop_us = 1e6 / rate
        self._soonest = 0
        self._interval: dict[int, int] = {}
        self._next: dict[int, int] = {}
        for message in MESSAGES:
            if message in self.available:
                self._set(message, self._default(message), 0)

    def interval(self, message: int) -> int | None:
        """Return the interval [us] of *message*; -1 if it is off, None if the message does not exist."""
        return self._interval.get(message, -1) if message in self.available else None

    def is_too_fast(self, interval: float) -> bool:
        """Return whether *interval* [us] is rejected because it is too short for the loop."""
        return 0.0 < interval * _DENY_SHARE < self._loop_us

    def request(self, message: int, interval: float, now_us: int) -> None:
        """Send *message* every *interval* [us]. 0 selects the message's default interval; a negative value stops the
        message.
        """
        if interval == 0.0:
            self._set(message, self._default(message), now_us)
        else:
            self._set(message, int(min(interval, _LONGEST_US)) if interval > 0.0 else -1, now_us)

    def due(self, now_us: int) -> Sequence[int]:
        """Return the ids of the messages due at *now_us* [us], in a fixed order."""
        if now_us < self._soonest:
            return ()
        messages = [message for message, when in self._next.items() if now_us >= when]
        for message in messages:
            interval = self._interval[message]
            self._next[message] = (now_us // interval + 1) * interval
        self._soonest = min(self._next.values(), default=_LONGEST_US)
        return messages

    @staticmethod
    def _default(message: int) -> int:
        rate = MESSAGES[message][1]
        return int(1e6 / rate) if rate else -1

    def _set(self, message: int, interval: int, now_us: int) -> None:
        if interval < 0:
            self._interval.pop(message, None)
            self._next.pop(message, None)
            return
        self._interval[message] = interval
        self._soonest = 0
        self._next[message] = (now_us // interval + 1) * interval
