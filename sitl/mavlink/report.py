"""What bookkeeping effects see of a message: its stamp and what it tells, SI, under SNAME names; and back again.

The craft itself never feels them: only what is sent is altered. ``t`` is the stamp [s]; ``servo`` is there when the
message reports the actuators, with the shares of full of ``N``, ``X`` (``Z``).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from sitl.mavlink.dialect import Message
from sitl.mavlink.telemetry import HOME, METRES_PER_DEGREE
from sitl.vehicle import Vehicle

__all__ = ["Reporter"]

_MASK = 0xFFFFFFFF


@dataclass(frozen=True, slots=True)
class _Field:
    """One field of a message: number = offset + scale * value, rounded when it is an integer on the wire."""

    attribute: str
    scale: float = 1.0
    whole: bool = False
    offset: float = 0.0
    turn: float = 0.0
    """What makes a full circle [number on the wire]; 0 when it is no angle."""

    def read(self, message: Message) -> float:
        return (float(getattr(message, self.attribute)) - self.offset) / self.scale

    def write(self, message: Message, value: float) -> None:
        number = self.offset + self.scale * value
        if self.turn:
            number = number % self.turn if self.whole else math.remainder(number, self.turn)
        setattr(message, self.attribute, round(number) if self.whole else number)


_BOOT = _Field("time_boot_ms", 1e3, whole=True)
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
    "SERVO_OUTPUT_RAW": {"t": _Field("time_usec", 1e6, whole=True)},
    "RC_CHANNELS": {"t": _BOOT},
    "SCALED_PRESSURE2": {"t": _BOOT},
    "SYSTEM_TIME": {"t": _BOOT},
}
"""Message -> name -> field."""
_VELOCITY = {"LOCAL_POSITION_NED": 1.0, "GLOBAL_POSITION_INT": 100.0}
"""Messages with ``vx vy``, over ground, times this; effects see them as ``u v``."""


class Reporter:
    """Alters messages on their way out, for the effects that want to."""

    def __init__(self, vehicle: Vehicle) -> None:
        self._vehicle = vehicle
        self._alters: list[Callable[[dict[str, float]], None]] = [
            effect.alter_report for effect in vehicle.effects if effect.overrides("alter_report")
        ]

    def __bool__(self) -> bool:
        return bool(self._alters)

    def alter(self, message: Message) -> None:
        """Let every effect at what *message* tells."""
        kind = message.get_type()
        fields = _FIELDS.get(kind)
        if fields is None:
            return
        told = {name: field.read(message) for name, field in fields.items()}
        if kind in _VELOCITY:
            told["u"], told["v"] = self._turned(message.vx / _VELOCITY[kind], message.vy / _VELOCITY[kind], -1.0)
        if kind == "SERVO_OUTPUT_RAW":
            pulses = [getattr(message, f"servo{n + 1}_raw") for n in range(len(self._vehicle.autopilot.pwm))]
            told.update(self._vehicle.actuators.read(pulses), servo=1.0)
        before = dict(told)
        for alter in self._alters:
            alter(told)
        for name, field in fields.items():
            if told[name] != before[name]:
                field.write(message, told[name])
                if name == "t":
                    setattr(message, field.attribute, max(getattr(message, field.attribute), 0) & _MASK)
        if kind in _VELOCITY and (told["u"], told["v"]) != (before["u"], before["v"]):
            vx, vy = self._turned(told["u"], told["v"], 1.0)
            scale = _VELOCITY[kind]
            message.vx, message.vy = (round(scale * vx), round(scale * vy)) if scale != 1.0 else (vx, vy)
        if kind == "SERVO_OUTPUT_RAW" and any(told[name] != before[name] for name in "NXZ" if name in told):
            for n, pulse in enumerate(self._vehicle.actuators.write(pulses, told)):
                setattr(message, f"servo{n + 1}_raw", pulse)

    def _turned(self, a: float, b: float, way: float) -> tuple[float, float]:
        yaw = self._vehicle.autopilot.estimate.yaw
        c, s = math.cos(yaw), way * math.sin(yaw)
        return c * a - s * b, s * a + c * b
